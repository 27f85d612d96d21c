"""Key files, which `risorius keys` writes."""

import re
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization

from protocol.security.link_security import KeyFile
from shared_model.errors import UserError

_PEM_BLOCK = re.compile(rb"-----BEGIN ([A-Z ]+)-----.*?-----END \1-----\r?\n?", re.DOTALL)
MAX_KEY_FILE_BYTES = 64 * 1024


def read_key_file(path: Path) -> KeyFile:
    """A key file as `risorius keys invite` writes it.  Raises `UserError` if it is none."""
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_KEY_FILE_BYTES)
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    blocks: dict[bytes, list[bytes]] = {}
    for match in _PEM_BLOCK.finditer(data):
        blocks.setdefault(match[1], []).append(match[0])
    certificates, keys = blocks.get(b"CERTIFICATE", []), blocks.get(b"PRIVATE KEY", [])
    if len(certificates) != 2 or len(keys) != 1:
        raise UserError(f"{path} is no key file; risorius keys invite writes one")
    try:
        for certificate in certificates:
            x509.load_pem_x509_certificate(certificate)
        serialization.load_pem_private_key(keys[0], None)
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UserError(f"{path} is no key file: a part of it is damaged") from error
    return KeyFile(certificates[0], certificates[1], keys[0])
