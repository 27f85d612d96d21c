"""What protects a link: an invitation's key, and certificates of mutual TLS as Zenoh takes them."""

import base64
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class KeyFile:
    """The authority that is trusted, the own certificate and its private key, each in PEM."""

    authority: bytes
    certificate: bytes
    private_key: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class LinkSecurity:
    """How a call is protected.

    key: of the invitation: the packets are encrypted from end to end; None: they are not.
    key_file: for endpoints with TLS: what is shown to the other end and asked of it; None: none.
    trusts_network: whoever on the local network says where the other end listens is believed; with
        a key that does no harm, and is done in any case.
    """

    key: bytes | None = field(default=None, repr=False)
    key_file: KeyFile | None = field(default=None, repr=False)
    trusts_network: bool = False

    @property
    def follows(self) -> bool:
        """Whether the other end is followed to where the local network says that it listens."""
        return self.trusts_network or self.key is not None


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
