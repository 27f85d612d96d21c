"""What the page of an end that waits shows to hand over: a line, and the same as a QR code."""

from protocol.endpoint import Endpoint, address_for_others


def card(line: str) -> dict[str, str]:
    """The line as text and as a QR code, an SVG element."""
    import segno

    code = segno.make(line, error="m", micro=False)
    return {"text": line, "svg": code.svg_inline(border=2, dark="#17181a", omitsize=True)}


def command_line(listen: Endpoint, name: str) -> str | None:
    """What the other end of an open call types; None: this host has no address for others.

    listen: where this end listens.  name: of the call.
    """
    host = address_for_others() if listen.is_any else listen.host
    if host is None:
        return None
    address = f"[{host}]:{listen.port}" if ":" in host else f"{host}:{listen.port}"
    return f"risorius call {address} --call {name}"
