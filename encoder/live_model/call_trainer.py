"""The trainers of a live call's models: each begins with the first picture of a person."""

from collections.abc import Sequence
from dataclasses import dataclass

from encoder.capture.video_source import VideoFormat
from encoder.coding.background import EncodeBackground, background_of, encoded_in_a_thread
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import BUDGETS, ModelBudget
from encoder.detection.landmark_indices import face_outline
from encoder.layers.layer_learning import layers_of_frame
from encoder.learning.incremental_modes import USUAL_LIMITS, ModeLimits
from encoder.live_model.model_trainer import ModelTrainer
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.pacing import Pacing
from shared_model.arrays import Array, Picture
from shared_model.surround import head_with_surround


@dataclass(frozen=True, slots=True, eq=False)
class FirstModel:
    """The first version of a person's model, and the trainer that has made it."""

    trainer: ModelTrainer
    version: ModelVersion


@dataclass(frozen=True, slots=True)
class CallTrainers:
    """Makes the trainers of one call.

    video: of the call.  budget, encode_background: see `ModelTrainer`.
    """

    video: VideoFormat
    gop: GopStructure
    budget: ModelBudget
    pacing: Pacing
    encode_background: EncodeBackground = encoded_in_a_thread

    @property
    def mode_limits(self) -> ModeLimits:
        """Of the modes that are learned from one model to the next."""
        usual = BUDGETS["live"].appearance_bytes
        return USUAL_LIMITS.scaled(self.budget.appearance_bytes / usual)

    def trainer(
        self, picture: Picture, points: Array, progressive: bool, first_number: int = 0
    ) -> ModelTrainer:
        """The trainer of the person in a picture (h, w, 3) BGR.

        points: their landmarks (468, 3), pixels.  progressive, first_number: see `ModelTrainer`.
        """
        first = picture, face_outline(points)
        # A base layer has no room for two pictures.
        has_layers = 0 in self.pacing.layer_updates and not progressive
        layers = layers_of_frame(*first) if has_layers else None
        return ModelTrainer(
            head_with_surround(),
            self.video,
            self.gop,
            background_of(*first) if layers is None else layers,
            self.budget,
            progressive,
            workers=self.pacing.training_threads,
            layer_updates=self.pacing.layer_updates,
            encode_background=self.encode_background,
            first_number=first_number,
        )

    def first_model(
        self,
        pictures: Sequence[Picture],
        points: Sequence[Array],
        progressive: bool,
        share: float | None = None,
    ) -> FirstModel:
        """The model that a call begins with; see `ModelTrainer.bootstrap`."""
        trainer = self.trainer(pictures[0], points[0], progressive)
        return FirstModel(trainer, trainer.bootstrap(pictures, points, share))
