"""Files with secrets in them."""

from pathlib import Path

import pytest

from protocol.security.private_file import write_private
from shared_model.errors import UserError


def test_a_secret_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "keys").mkdir()
    with pytest.raises(UserError, match="cannot write"):
        write_private(tmp_path / "keys", b"secret")
    assert [path.name for path in tmp_path.iterdir()] == ["keys"]
