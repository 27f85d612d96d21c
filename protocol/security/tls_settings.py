"""Certificates, as Zenoh takes them."""

import base64
from typing import Any

from protocol.security.link_security import KeyFile


def tls_settings(keys: KeyFile) -> dict[str, Any]:
    """Zenoh's section `transport/link/tls`: both ends show a certificate of the one authority."""
    certificate, private_key = _base64(keys.certificate), _base64(keys.private_key)
    return {
        "root_ca_certificate_base64": _base64(keys.authority),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
        "listen_certificate_base64": certificate,
        "listen_private_key_base64": private_key,
        "connect_certificate_base64": certificate,
        "connect_private_key_base64": private_key,
    }


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
