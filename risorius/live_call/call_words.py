"""What the page says of a call, in words: its state, and what it costs."""

from dataclasses import dataclass

from protocol.limits import DEFAULT_CALL
from protocol.link.interface import IP_OVERHEAD_BYTES, ZENOH_OVERHEAD_BYTES, Reachability
from risorius.live_call.messages import Presence, Receiving, Sending, Traffic

# Who calls for so long and reaches nobody is told so.
PATIENCE_S = 15.0
# What a packet takes beside its payload on the way over UDP; over TCP it is more.
OVERHEAD_BYTES = ZENOH_OVERHEAD_BYTES["udp"] + IP_OVERHEAD_BYTES["udp"]


@dataclass(frozen=True, slots=True)
class Words:
    """text: beside the name; over: over the picture, "" where that is shown.

    is_trouble: something is wrong.
    """

    text: str
    over: str = ""
    is_trouble: bool = False


def state_words(
    name: str,
    is_listening: bool,
    has_picture: bool,
    sending: Sending | None,
    presence: Presence,
    is_camera_off: bool = False,
    waited_s: float = 0.0,
    knows_person: bool = False,
) -> Words:
    """The state of a call.

    name: of the person if `knows_person`, else of the call.
    is_listening: this end waits for the other to call.
    has_picture: the other person has been seen since they came.
    sending: None: nothing is known yet.  is_camera_off: the other end's.
    waited_s: how long this end has been there.
    """
    reach = None if sending is None else sending.reach
    # A call is named by who listens, or by nobody: that is not the name of who calls there.
    is_unknown = not knows_person and (is_listening or name == DEFAULT_CALL)
    other, caller = ("The other one", "Somebody") if is_unknown else (name, name)
    if reach == Reachability.BUSY:
        return Words("is in another call", f"{other} is in another call.")
    if presence is Presence.LEFT and reach != Reachability.HAS_PEER:
        return Words("has left", f"{other} has left.")
    # Whoever has been heard only begins a call, or was lost before the first picture.
    is_gone = has_picture or reach == Reachability.NO_PEER
    is_silent = presence is Presence.SILENT and is_gone
    if is_silent or reach == Reachability.NO_LINK:
        over = "" if has_picture else "Link lost, trying …"
        return Words("link lost, trying", over, is_trouble=True)
    if has_picture:
        return Words("camera off" if is_camera_off else "")
    if reach == Reachability.HAS_PEER or presence in (Presence.HERE, Presence.SILENT):
        if is_listening:
            return Words("is calling", f"{caller} is calling …")
        return Words("answers", f"{other} answers …")
    if is_listening:
        return Words("waiting for a call", "Waiting for a call …")
    if waited_s > PATIENCE_S and reach == Reachability.NO_PEER:
        return Words("nobody there yet", f"{other} is not there yet. Waiting …")
    return Words("calling", "Calling …" if is_unknown else f"Calling {name} …")


def stranger_words(is_listening: bool) -> str:
    """What is said once when packets come that are not of this call."""
    if is_listening:
        return "somebody without this invitation knocks, and is not heard"
    return "who is there cannot be read: is the invitation of another call?"


def cost_words(sending: Sending | None, receiving: Receiving | None) -> str:
    """What the call costs, in one line; without the delay, which the page knows."""
    parts = []
    if sending is not None and sending.reach == Reachability.HAS_PEER:
        parts.append(f"up {_rates(sending.traffic)}")
    if receiving is not None and receiving.presence is Presence.HERE:
        parts.append(f"down {_rates(receiving.traffic)}")
        parts.append(f"loss {100 * max(receiving.lost, _loss(sending)):.0f}\u00a0%")
    if sending is not None:
        parts.append(sending.face)
    return " · ".join(parts)


def delay_ms(sending: Sending | None, receiving: Receiving | None) -> float | None:
    """What is known of the delay of the other person's pictures before they are drawn, ms.

    A packet fills, and goes half a round trip.  None: nothing is known.
    """
    if receiving is None or receiving.presence is not Presence.HERE or not receiving.packet_s:
        return None
    round_trip_s = None if sending is None else sending.round_trip_s
    return 1000 * (receiving.packet_s + (round_trip_s or 0.0) / 2)


def _loss(sending: Sending | None) -> float:
    return 0.0 if sending is None else sending.loss


def _rates(traffic: Traffic) -> str:
    seconds = max(traffic.seconds, 1e-3)
    payload = 8 * traffic.payload_bytes / seconds
    total = payload + 8 * OVERHEAD_BYTES * traffic.packets / seconds
    return f"{_grouped(payload)} bit/s (UDP {_grouped(total)})"


def _grouped(value: float) -> str:
    return f"{value:,.0f}".replace(",", "\u202f")
