"""What the page of an end that waits shows to hand over: a line, and the same as a QR code."""

from protocol.endpoint import Endpoint, address_for_others


def card(line: str) -> dict[str, str]:
    """The line as text and as a QR code, an SVG element."""
    import segno

    code = segno.make(line, error="m", micro=False)
    return {"text": line, "svg": code.svg_inline(border=2, dark="#17181a", omitsize=True)}


def own_host(listen: Endpoint) -> str | None:
    """The address under which others reach this end; None: this host has none.

    listen: where it listens.
    """
    return address_for_others() if listen.is_any else listen.host


def command_line(listen: Endpoint, name: str, is_insecure: bool) -> str | None:
    """What the other end of an open call types; None: this host has no address for others.

    name: of the call.  is_insecure: it leaves this host without encryption.
    """
    host = own_host(listen)
    if host is None:
        return None
    address = f"[{host}]:{listen.port}" if ":" in host else f"{host}:{listen.port}"
    return f"risorius call {address} --call {name}{' --insecure' if is_insecure else ''}"
