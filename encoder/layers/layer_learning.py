"""The layers of a call's person, where the segmentation network is installed and finds them."""

from encoder.detection.segmentation import PersonSegmenter
from encoder.detection.tflite import find_segmentation_network
from encoder.layers.layer_model import LayerModel, learn_layers
from encoder.layers.layer_samples import FittedFrames, collect_samples

NO_NETWORK = (
    "the segmentation network is not installed: shoulders and scene are one picture (pip install"
    " 'mediapipe==0.10.14')"
)
NO_PERSON = "the person cannot be told from the scene: both are one picture"


def layers_of_person(frames: FittedFrames) -> tuple[LayerModel | None, str]:
    """The layers of a sample of frames; None and why, if there are none."""
    path = find_segmentation_network()
    if path is None:
        return None, NO_NETWORK
    samples = collect_samples(PersonSegmenter(path).matte, frames)
    if samples is None:
        return None, NO_PERSON
    return learn_layers(frames.person, samples), ""
