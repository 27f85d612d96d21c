"""What Zenoh is told for each end of a link."""

from protocol.endpoint import parse_endpoint
from protocol.link.interface import LinkOptions
from protocol.link.zenoh_settings import client_settings, listener_settings, security_settings
from protocol.security.link_security import KeyFile, LinkSecurity


def test_who_listens_without_a_scheme_offers_udp_and_tcp() -> None:
    options = LinkOptions("anna", listen=("127.0.0.1:7447",))
    settings = listener_settings(options, options.listen_locators)
    offered = settings["listen/endpoints"]
    assert any(each.startswith("udp/") for each in offered)
    assert any(each.startswith("tcp/") for each in offered)


def test_who_repeats_what_is_lost_has_longer_to_connect() -> None:
    udp, tcp = (
        client_settings(parse_endpoint(f"{each}/127.0.0.1:7447")) for each in ("udp", "tcp")
    )
    limit = "transport/unicast/open_timeout"
    assert 0 < udp[limit] < tcp[limit]


def test_certificates_are_shown_only_where_there_are_any() -> None:
    assert security_settings(LinkSecurity()) == {}
    keys = KeyFile(b"authority", b"certificate", b"key")
    shown = security_settings(LinkSecurity(key_file=keys))["transport/link/tls"]
    assert shown["enable_mtls"] is True
