"""What the page of an end that waits shows to hand over: a line, and the same as a QR code."""

from protocol.endpoint import Endpoint, address_for_others
from protocol.security.invitation import format_key


def card(line: str, watch: str | None = None) -> dict[str, str]:
    """The line as text, and a QR code, an SVG element: of the line, or of what a phone opens.

    watch: address of a page that watches this end; None: there is none.
    """
    import segno

    code = segno.make(watch or line, error="m", micro=False)
    svg = code.svg_inline(border=2, dark="#17181a", omitsize=True)
    return {"text": line, "svg": svg, "watch": watch or ""}


def watch_address(listen: Endpoint, port: int, call: str, key: bytes | None) -> str | None:
    """The address at which a browser elsewhere watches a call; None: no host can reach this one.

    listen: where this end listens.  port: of the pages.  key: of the invitation; it stands behind a
    #, which browsers do not send.
    """
    host = own_host(listen)
    if host is None:
        return None
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/{call}" + (f"#{format_key(key)}" if key is not None else "")


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
