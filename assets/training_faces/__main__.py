"""Make calls of people who do not exist, to train the probability model on.

    python -m assets.training_faces PICTURES calls --count 24
    python -m assets.train_probability_model calls/*.rzo

PICTURES is the folder `skimage/data` of the wheel scikit-image: the portrait of an astronaut by
NASA (public domain) and photographs (CC0 or public domain) that stand behind the faces.  A person
is her face or the painted one of `risorius animate`, recoloured, reshaped and overlaid with
spots, stubble and folds; their video moves at random in a changing light, with folds that deepen
with the expression, and the noise of a camera.  The video is encoded as any other.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

import risorius
from assets.training_faces.motion import FPS, FRAMES, make_motion, wander
from assets.training_faces.skin import SWINGS, make_skin
from assets.training_faces.stills import painted, portrait
from benchmarks.command import run, warn
from decoder.scene.appearance import FrameTextures
from decoder.scene.decoded_model import decoded_model
from decoder.scene.reenactment import read_model
from decoder.scene.scene import Scene
from decoder.sinks.frame_sink import open_sink
from protocol.model_packet import ModelPacket
from shared_model.arrays import Array, Picture
from shared_model.geometry import multiply, normalise, quaternion_from_vector
from shared_model.parameters import AAUS, FaceParameters, Pose
from shared_model.stage_timer import StageTimer

# Bytes of a model packet between these.
MODEL_BYTES = (5500, 16000)
# Each so-manieth person has the painted head.
PAINTED_EVERY = 5


def model_of(picture: Picture, folder: Path) -> ModelPacket:
    """The finest model of a still picture."""
    for number in range(3):
        cv2.imwrite(str(folder / f"still_{number}.png"), picture)
    call = folder / "still.rzo"
    risorius.encode(folder / "still_%d.png", call, model_bytes=30_000)
    return read_model(call)


def draw(random: np.random.Generator, model: ModelPacket, output: Path) -> None:
    """A video of a new person with the head, camera and background of a model."""
    eau, turn, shift = make_motion(random)
    skin = make_skin(random, FrameTextures(model).synthesise(np.zeros(0)))
    swings = np.array(SWINGS) * random.uniform(0.3, 1.2, len(SWINGS))
    swings[:2] = random.choice([0.02, 0.05, 0.25])
    swing = np.array([wander(random, 0.5, -reach, reach) for reach in swings]).T
    # The light stays where it is while the head turns.
    swing[:, :3] += 0.012 * turn[:, [1, 0, 1]] * random.uniform(0.2, 1, 3)
    noise, blur = random.uniform(0, 4), random.uniform(0, 1.2)
    call, timer = model.call, StageTimer()
    scene = Scene(decoded_model(model))
    try:
        scene.set_aau_offset(random.uniform(-0.5, 0.5, len(AAUS)))
        with open_sink(output, call.width, call.height, FPS) as sink:
            for number in range(FRAMES):
                pose = moved(model.reference_pose, turn[number], shift[number])
                face = FaceParameters(pose, eau[number])
                texture = skin.at(eau[number], swing[number])
                scene.submit(replace(scene.prepare(face, timer), texture=texture), timer)
                sink.write(filmed(random, scene.read_back(timer), noise, blur))
    finally:
        scene.close()


def moved(home: Pose, turn_deg: Array, shift_mm: Array) -> Pose:
    """The pose, turned in the head's axes and moved in those of the camera."""
    turned = multiply(home.rotation, quaternion_from_vector(np.radians(turn_deg)))
    return Pose(normalise(turned), home.translation_mm + shift_mm)


def filmed(random: np.random.Generator, picture: Picture, noise: float, blur: float) -> Picture:
    """The picture through a lens (blur, pixels) and a sensor (noise, grey levels)."""
    value = picture.astype(np.float32)
    if blur > 0.3:
        value = np.asarray(cv2.GaussianBlur(value, (0, 0), blur), np.float32)
    value += noise * random.standard_normal(value.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(value), 0, 255), np.uint8)


def main(arguments: Sequence[str]) -> None:
    """Make the people, draw and encode them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("pictures", type=Path, help="folder skimage/data of scikit-image")
    parser.add_argument("output", type=Path, help="folder for the calls")
    parser.add_argument("--count", type=int, default=24, help="number of people (default: 24)")
    parser.add_argument("--first", type=int, default=0, help="number of the first (default: 0)")
    options: Any = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    for number in range(options.first, options.first + options.count):
        call = options.output / f"{number:02d}.rzo"
        try:
            make_call(number, options.pictures, call)
        except risorius.UserError as error:
            warn(f"{call} is left out: {error}")


def make_call(number: int, pictures: Path, call: Path) -> None:
    """Make person `number` and encode their video.  Raises `UserError` if no face is found."""
    random = np.random.default_rng(number)
    with TemporaryDirectory() as name:
        folder, is_painted = Path(name), number % PAINTED_EVERY == PAINTED_EVERY - 1
        still = painted(random, pictures, folder) if is_painted else portrait(random, pictures)
        video = folder / "video.mp4"
        draw(random, model_of(still, folder), video)
        budget = int(np.exp(random.uniform(*np.log(MODEL_BYTES))))
        report = risorius.encode(video, call, model_bytes=budget)
        warn(f"{call}: {report.sent.model_bytes} bytes of {budget}")


if __name__ == "__main__":
    run(main)
