"""The trainer of a live call's models, from the first picture of the caller."""

from encoder.capture.video_source import VideoFormat
from encoder.coding.background import EncodeBackground, background_of, encoded_in_a_thread
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import ModelBudget
from encoder.detection.landmark_indices import face_outline
from encoder.layers.layer_learning import layers_of_frame
from encoder.live_model.model_trainer import ModelTrainer
from encoder.live_model.pacing import Pacing
from shared_model.arrays import Array, Picture
from shared_model.surround import head_with_surround


def trainer_from(
    picture: Picture,
    points: Array,
    video: VideoFormat,
    gop: GopStructure,
    budget: ModelBudget,
    progressive: bool,
    pacing: Pacing,
    encode_background: EncodeBackground = encoded_in_a_thread,
    first_number: int = 0,
) -> ModelTrainer:
    """The trainer of the person in a picture (h, w, 3) BGR.  points: their landmarks (468, 3), px.

    budget, progressive, encode_background, first_number: see `ModelTrainer`.
    """
    first = picture, face_outline(points)
    # A base layer has no room for two pictures.
    has_layers = 0 in pacing.layer_updates and not progressive
    layers = layers_of_frame(*first) if has_layers else None
    return ModelTrainer(
        head_with_surround(),
        video,
        gop,
        background_of(*first) if layers is None else layers,
        budget,
        progressive,
        workers=pacing.training_threads,
        layer_updates=pacing.layer_updates,
        encode_background=encode_background,
        first_number=first_number,
    )
