"""The keys of a relay: a private certificate authority in a folder, a certificate for each peer.

    authority.crt  authority.key     the authority's own; the key never leaves the folder
    relay.keys                       what the relay shows to its peers
    peers.json                       who was invited to which call, and who was revoked

A peer gets one file: the authority's certificate, its own, and its private key, in PEM.
"""

import json
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from ipaddress import ip_address
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from protocol.limits import CALL_NAME, CALL_NAME_RULE
from protocol.security.private_file import write_private
from shared_model.errors import UserError, cannot_write

AUTHORITY_CERTIFICATE, AUTHORITY_KEY = "authority.crt", "authority.key"
RELAY_KEYS, PEERS = "relay.keys", "peers.json"
RELAY_NAME = "relay"
AUTHORITY_DAYS, PEER_DAYS = 3650, 365
# A clock that is behind takes a new certificate nevertheless.
CLOCK_TOLERANCE = timedelta(hours=1)

_PEER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")


class PeerRole(StrEnum):
    """What a peer may do in its call: send the face, or watch it."""

    CALLER = "caller"
    VIEWER = "viewer"


@dataclass(frozen=True, slots=True)
class InvitedPeer:
    """A peer that was invited.

    name: in its certificate.  serial: of the certificate, hexadecimal.  expires: date, ISO 8601.
    """

    name: str
    call: str
    role: PeerRole
    serial: str
    expires: str
    revoked: bool = False


def create_authority(folder: Path, hosts: Sequence[str], now: datetime) -> None:
    """Make the authority in `folder`, which is made, and the relay's own key file.

    hosts: names and addresses under which peers reach the relay.  now: with a time zone.
    Raises `UserError` if the folder has an authority already, or a host cannot be one.
    """
    if (folder / AUTHORITY_KEY).exists():
        raise UserError(f"{folder} holds keys already; choose another folder")
    names = _alternative_names(hosts)
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise cannot_write(folder, error) from error
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name("Risorius authority")
    certificate = (
        _builder(name, name, key.public_key(), now, AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs_certificates=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    write_private(folder / AUTHORITY_CERTIFICATE, _pem(certificate), 0o644)
    write_private(folder / AUTHORITY_KEY, _pem_of_key(key))
    bundle, _ = _issue(folder, RELAY_NAME, names, now, AUTHORITY_DAYS)
    write_private(folder / RELAY_KEYS, bundle)
    _write_peers(folder, [])


def invite_peer(
    folder: Path,
    name: str,
    call: str,
    role: PeerRole,
    now: datetime,
    days: int = PEER_DAYS,
    save: Callable[[bytes], None] = lambda keys: None,
) -> bytes:
    """The key file of a new peer, which is valid for `days`.

    save: called with it before the peer is recorded; if it raises, nobody is invited.
    Raises `UserError` if there is no authority, the name is taken or cannot be one.
    """
    peers = read_peers(folder)
    if not _PEER_NAME.fullmatch(name) or name == RELAY_NAME:
        raise UserError(f"peer name {name!r}: use a-z, A-Z, 0-9 and _ . -, and not {RELAY_NAME}")
    if not CALL_NAME.fullmatch(call):
        raise UserError(f"call name {call!r}: {CALL_NAME_RULE}")
    if any(peer.name == name for peer in peers):
        raise UserError(f"{name} was invited already; a revoked peer needs a new name")
    bundle, certificate = _issue(folder, name, [x509.DNSName(name)], now, days)
    expires = certificate.not_valid_after_utc.date().isoformat()
    peer = InvitedPeer(name, call, role, f"{certificate.serial_number:x}", expires)
    save(bundle)
    _write_peers(folder, [*peers, peer])
    return bundle


def revoke_peer(folder: Path, name: str) -> None:
    """Let the relay refuse a peer from now on.  Raises `UserError` if there is none such."""
    peers = read_peers(folder)
    if all(peer.name != name for peer in peers):
        raise UserError(f"{folder} has invited nobody of the name {name}")
    _write_peers(
        folder, [replace(peer, revoked=True) if peer.name == name else peer for peer in peers]
    )


def read_peers(folder: Path) -> tuple[InvitedPeer, ...]:
    """All peers that were invited, in order.  Raises `UserError` if the folder has no keys."""
    try:
        entries = json.loads((folder / PEERS).read_text(encoding="utf-8"))
        return tuple(InvitedPeer(**{**entry, "role": PeerRole(entry["role"])}) for entry in entries)
    except FileNotFoundError as error:
        raise UserError(f"{folder} holds no keys; make some: risorius keys new {folder}") from error
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise UserError(f"{folder / PEERS} cannot be read: {error}") from error


def _issue(
    folder: Path, name: str, hosts: Sequence[x509.GeneralName], now: datetime, days: int
) -> tuple[bytes, x509.Certificate]:
    """Key file and certificate for `name`, signed by the authority of `folder`."""
    try:
        authority_pem = (folder / AUTHORITY_CERTIFICATE).read_bytes()
        signer = serialization.load_pem_private_key((folder / AUTHORITY_KEY).read_bytes(), None)
        authority = x509.load_pem_x509_certificate(authority_pem)
    except (OSError, ValueError) as error:
        raise UserError(f"the authority in {folder} cannot be read: {error}") from error
    assert isinstance(signer, ec.EllipticCurvePrivateKey)
    key = ec.generate_private_key(ec.SECP256R1())
    usage = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key())
    certificate = (
        _builder(_name(name), authority.subject, key.public_key(), now, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        .add_extension(x509.SubjectAlternativeName(hosts), critical=False)
        .add_extension(issuer, critical=False)
        .sign(signer, hashes.SHA256())
    )
    return authority_pem + _pem(certificate) + _pem_of_key(key), certificate


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    public_key: ec.EllipticCurvePublicKey,
    now: datetime,
    days: int,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now.astimezone(UTC) - CLOCK_TOLERANCE)
        .not_valid_after(now.astimezone(UTC) + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
    )


def _key_usage(signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _alternative_names(hosts: Iterable[str]) -> list[x509.GeneralName]:
    names: list[x509.GeneralName] = []
    for host in hosts:
        try:
            names.append(x509.IPAddress(ip_address(host.strip("[]"))))
        except ValueError:
            if not _PEER_NAME.fullmatch(host):
                raise UserError(f"host {host!r}: expected a name or an address") from None
            names.append(x509.DNSName(host))
    return names


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _pem_of_key(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _write_peers(folder: Path, peers: Iterable[InvitedPeer]) -> None:
    text = json.dumps([asdict(peer) for peer in peers], indent=1) + "\n"
    write_private(folder / PEERS, text.encode())
