"""The landmark networks' runner: the same for one picture and several, quiet, and plain about files
it cannot read."""

from pathlib import Path

import numpy as np
import pytest

from encoder.networks import IRIS, Network, NetworkFilesMissing

SIDE = 64


def test_several_pictures_give_what_each_gives_alone(networks: Path) -> None:
    network = Network(networks / IRIS)
    pictures = list(np.random.default_rng(3).integers(0, 256, (3, SIDE, SIDE, 3), np.uint8))
    together = network.run_all(pictures, 0.0)
    for number, picture in enumerate(pictures):
        alone = network.run(picture, 0.0)
        assert alone.keys() == together.keys()
        for length, output in alone.items():
            assert output.shape == (length,)
            np.testing.assert_array_equal(output, together[length][number])


def test_the_picture_is_read_as_blue_green_red_on_the_scale_asked_for(networks: Path) -> None:
    network = Network(networks / IRIS)
    red, blue = (np.zeros((SIDE, SIDE, 3), np.uint8) for _ in range(2))
    red[..., 2], blue[..., 0] = 255, 255
    (first, *_), (second, *_) = (network.run(each, 0.0).values() for each in (red, blue))
    (scaled, *_) = network.run(red, -1.0).values()
    assert np.abs(first - second).max() > 0.1 < np.abs(first - scaled).max()


def test_a_network_is_loaded_without_a_word(
    networks: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    Network(networks / IRIS)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_damaged_file_is_named(networks: Path, tmp_path: Path, share: float) -> None:
    data, path = (networks / IRIS).read_bytes(), tmp_path / IRIS
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(NetworkFilesMissing, match=rf"{IRIS} is not a network LiteRT can read"):
        Network(path)
