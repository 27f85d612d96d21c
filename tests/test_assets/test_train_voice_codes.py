"""Training of the prefix codes of the voice."""

from pathlib import Path

import numpy as np
import pytest
from sounds import voiced_sound, write_wave

from assets.train_voice_codes.__main__ import code_lengths, main
from protocol.voice.codec2_bits import PrefixCode
from shared_model.errors import UserError


def test_frequent_symbols_have_short_codes_and_rare_ones_have_one() -> None:
    lengths = code_lengths(np.array([0, 8000, 500, 100, 4000]))
    assert lengths == [4, 1, 3, 4, 2]
    PrefixCode(lengths)


def test_speech_takes_less_with_codes_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pycodec2")
    write_wave(tmp_path / "buzz.wav", voiced_sound(40_000), 8000)
    main([str(tmp_path)])
    *codes, figures = capsys.readouterr().out.splitlines()
    assert [len(lengths) for lengths in codes] == [16, 256, 512]
    in_use, _, new = figures.split(": ")[1].split()[:3]
    assert float(new) < float(in_use.rstrip(",")) < 48


def test_a_folder_without_speech_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("pycodec2")
    with pytest.raises(UserError, match="nobody speaks"):
        main([str(tmp_path)])
