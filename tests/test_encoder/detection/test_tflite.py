"""TFLite networks: outputs, input range, messages and unreadable files."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from encoder.detection.tflite import IRIS, NetworkFilesMissing, TfliteNetwork

SIDE = 64


def test_outputs_are_told_by_their_lengths_and_stay_as_they_are(networks: Path) -> None:
    network = TfliteNetwork(networks / IRIS)
    pictures = list(np.random.default_rng(3).integers(0, 256, (3, SIDE, SIDE, 3), np.uint8))
    together = [network.run(picture, 0.0) for picture in pictures]
    for number, picture in enumerate(pictures):
        alone = network.run(picture, 0.0)
        assert alone.keys() == together[number].keys()
        for length, output in alone.items():
            assert output.shape == (length,)
            np.testing.assert_array_equal(output, together[number][length])


def test_pictures_are_bgr_and_scaled_to_the_given_range(networks: Path) -> None:
    network = TfliteNetwork(networks / IRIS)
    red, blue = (np.zeros((SIDE, SIDE, 3), np.uint8) for _ in range(2))
    red[..., 2], blue[..., 0] = 255, 255
    (first, *_), (second, *_) = (network.run(each, 0.0).values() for each in (red, blue))
    (scaled, *_) = network.run(red, -1.0).values()
    assert np.abs(first - second).max() > 0.1 < np.abs(first - scaled).max()


@pytest.mark.parametrize("closed", ["", "2>&-"])
def test_a_network_loads_without_messages(networks: Path, closed: str) -> None:
    # In a new process, since LiteRT writes its message once.
    load = (
        "import sys; from pathlib import Path; from encoder.detection.tflite import TfliteNetwork;"
    )
    load += (
        "TfliteNetwork(Path(sys.argv[1])); print('loaded', file=sys.stderr) if sys.stderr else 0"
    )
    command = f'exec "$0" -c "$1" "$2" {closed}'
    arguments = ["sh", "-c", command, sys.executable, load, str(networks / IRIS)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == ("" if closed else "loaded\n")


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_damaged_file_is_named(networks: Path, tmp_path: Path, share: float) -> None:
    data, path = (networks / IRIS).read_bytes(), tmp_path / IRIS
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(NetworkFilesMissing, match=rf"{IRIS} is not a network LiteRT can read"):
        TfliteNetwork(path)
