"""The keys of a relay: who was invited, who was revoked, and what is in a key file."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID

from protocol.security.authority import (
    RELAY_KEYS,
    PeerRole,
    create_authority,
    invite_peer,
    read_peers,
    revoke_peer,
)
from protocol.security.key_file import read_key_file
from protocol.security.private_file import write_private
from shared_model.errors import UserError

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    create_authority(tmp_path / "keys", ["relay.example", "192.0.2.7", "[2001:db8::7]"], NOW)
    return tmp_path / "keys"


def test_a_certificate_names_the_peer_and_is_signed_by_the_authority(
    folder: Path, tmp_path: Path
) -> None:
    path = tmp_path / "anna.keys"
    path.write_bytes(invite_peer(folder, "anna", "call", PeerRole.CALLER, NOW, 30))
    keys = read_key_file(path)
    authority = x509.load_pem_x509_certificate(keys.authority)
    certificate = x509.load_pem_x509_certificate(keys.certificate)
    certificate.verify_directly_issued_by(authority)
    (name,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert name.value == "anna"
    assert certificate.not_valid_before_utc <= NOW
    assert certificate.not_valid_after_utc == NOW + timedelta(days=30)
    key = load_pem_private_key(keys.private_key, None)
    assert key.public_key() == certificate.public_key()
    (peer,) = read_peers(folder)
    assert (peer.name, peer.call, peer.role, peer.revoked) == ("anna", "call", "caller", False)
    assert peer.serial == f"{certificate.serial_number:x}"
    assert peer.expires == "2026-02-01"


def test_the_relay_shows_all_its_names(folder: Path) -> None:
    certificate = x509.load_pem_x509_certificate(read_key_file(folder / RELAY_KEYS).certificate)
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["relay.example"]
    addresses = map(str, names.get_values_for_type(x509.IPAddress))
    assert list(addresses) == ["192.0.2.7", "2001:db8::7"]


def test_who_is_revoked_stays_on_the_list(folder: Path) -> None:
    for name in ("anna", "bob"):
        invite_peer(folder, name, "call", PeerRole.VIEWER, NOW)
    revoke_peer(folder, "anna")
    assert [(peer.name, peer.revoked) for peer in read_peers(folder)] == [
        ("anna", True),
        ("bob", False),
    ]
    with pytest.raises(UserError, match="needs a new name"):
        invite_peer(folder, "anna", "call", PeerRole.VIEWER, NOW)
    with pytest.raises(UserError, match="nobody of the name berta"):
        revoke_peer(folder, "berta")


@pytest.mark.parametrize("name", ["", "relay", "a b", "../a", "-a", 64 * "a"])
def test_names_of_peers_are_plain(folder: Path, name: str) -> None:
    with pytest.raises(UserError, match="peer name"):
        invite_peer(folder, name, "call", PeerRole.CALLER, NOW)


def test_calls_and_hosts_are_checked(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="call name"):
        invite_peer(folder, "anna", "a/b", PeerRole.CALLER, NOW)
    with pytest.raises(UserError, match="host 'a b'"):
        create_authority(tmp_path / "other", ["a b"], NOW)
    with pytest.raises(UserError, match="holds keys already"):
        create_authority(folder, ["host"], NOW)
    file = tmp_path / "file"
    file.write_text("no folder")
    with pytest.raises(UserError, match="file"):
        create_authority(file / "keys", ["host"], NOW)


def test_a_folder_without_keys_or_with_damaged_ones_is_one_line(
    folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match="risorius keys new"):
        read_peers(tmp_path)
    (folder / "authority.key").write_text("nothing")
    with pytest.raises(UserError, match="cannot be read"):
        invite_peer(folder, "anna", "call", PeerRole.CALLER, NOW)
    (folder / "peers.json").write_text("[1]")
    with pytest.raises(UserError, match="cannot be read"):
        read_peers(folder)


def test_only_the_owner_reads_secrets(folder: Path) -> None:
    for name in ("authority.key", RELAY_KEYS, "peers.json"):
        assert (folder / name).stat().st_mode & 0o777 == 0o600
    with pytest.raises(UserError, match="cannot write"):
        write_private(folder / "none" / "file", b"")


def test_what_is_no_key_file_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read"):
        read_key_file(tmp_path / "none.keys")
    path = tmp_path / "some.keys"
    path.write_text("nothing")
    with pytest.raises(UserError, match="no key file"):
        read_key_file(path)
    keys = (folder / RELAY_KEYS).read_text()
    path.write_text(keys.replace("BEGIN PRIVATE KEY-----\n", "BEGIN PRIVATE KEY-----\nAAAA"))
    with pytest.raises(UserError, match="damaged"):
        read_key_file(path)
    assert "PRIVATE" not in repr(read_key_file(folder / RELAY_KEYS))
