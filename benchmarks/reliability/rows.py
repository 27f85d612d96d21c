"""The links that calls are measured over, and what happens to their ends meanwhile."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from benchmarks.bad_wire.wire import Faults

# Which host is which.  The decoder listens and the encoder connects, or both connect to the relay.
DECODER, ENCODER, RELAY = 0, 1, 2
# Seconds that a call lasts at least in which something happens, with time to go on afterwards.
EVENT_S, AGAIN_S = 6.0, 1.0
SHORT_S, LONG_S = 12.0, 75.0
QUIC = "udp/{}?rel=1;mixed_rel=1"


class Action(StrEnum):
    """What happens to a host."""

    KILL = "killed"
    START = "started"
    MOVE = "another address"


@dataclass(frozen=True, slots=True)
class Event:
    """Seconds after both ends have met, something happens to a host."""

    at_s: float
    host: int
    action: Action


@dataclass(frozen=True, slots=True)
class Row:
    """Calls over one link.

    endpoint: of who listens, with {} for its host and port.  layers: the model is sent in layers.
    least_s: how long the call lasts at least.  seeds: how many calls there are.
    sframe: it is protected by a key.  relay: over a relay.
    """

    name: str
    faults: Faults
    endpoint: str = "{}"
    events: tuple[Event, ...] = ()
    layers: bool = False
    least_s: float = 0.0
    seeds: int = 1
    sframe: bool = False
    relay: bool = False


def _again(host: int) -> tuple[Event, ...]:
    return (
        Event(EVENT_S, host, Action.KILL),
        Event(EVENT_S + AGAIN_S, host, Action.START),
    )


def _moved(host: int) -> tuple[Event, ...]:
    return (Event(EVENT_S, host, Action.MOVE),)


def _with_repairs(name: str, endpoint: str) -> Iterator[Row]:
    """Rows of a transport that is chosen by name."""
    clean = Faults(delay_ms=50)
    cut = Faults(delay_ms=50, cuts=((EVENT_S, EVENT_S + 3),))
    radio = Faults(rate_bps=9600, delay_ms=300)
    for loss in (0, 5, 25):
        yield Row(f"{name}, {loss} %, 50 ms", Faults(loss=loss / 100, delay_ms=50), endpoint)
    bursts = Faults(loss=0.1, burst=3, delay_ms=50)
    yield Row(f"{name}, 10 % in bursts of 3, 50 ms", bursts, endpoint)
    yield Row(f"{name}, 50 ms +- 50 ms", Faults(delay_ms=50, jitter_ms=50), endpoint)
    yield Row(f"{name}, 9.6 kbit/s, 300 ms", radio, endpoint, layers=True)
    yield Row(f"{name}, cut 6 to 9 s, 50 ms", cut, endpoint, least_s=SHORT_S)
    yield Row(f"{name}, encoder killed", clean, endpoint, _again(ENCODER), least_s=SHORT_S)
    yield Row(f"{name}, decoder killed", clean, endpoint, _again(DECODER), least_s=SHORT_S)


_CLEAN, _LOSSY = Faults(delay_ms=50), Faults(loss=0.1, delay_ms=50)
ROWS = (
    Row("0 %, 50 ms", _CLEAN),
    Row("5 %, 50 ms", Faults(loss=0.05, delay_ms=50), seeds=3, least_s=SHORT_S),
    Row("10 %, 50 ms", _LOSSY, seeds=3, least_s=SHORT_S),
    Row("25 %, 50 ms", Faults(loss=0.25, delay_ms=50), seeds=3, least_s=SHORT_S),
    Row(
        "10 % in bursts of 3, 50 ms",
        Faults(loss=0.1, burst=3, delay_ms=50),
        seeds=3,
        least_s=SHORT_S,
    ),
    Row("0 %, 300 ms", Faults(delay_ms=300)),
    Row("5 %, 300 ms", Faults(loss=0.05, delay_ms=300), seeds=3),
    Row("50 ms +- 50 ms", Faults(delay_ms=50, jitter_ms=50)),
    Row("2 % twice, 50 ms", Faults(duplicates=0.02, delay_ms=50)),
    Row("9.6 kbit/s, 300 ms", Faults(rate_bps=9600, delay_ms=300), layers=True),
    Row("4.8 kbit/s, 300 ms", Faults(rate_bps=4800, delay_ms=300), layers=True),
    Row("cut 6 to 9 s, 50 ms", Faults(delay_ms=50, cuts=((6, 9),)), least_s=SHORT_S),
    Row("cut 6 to 66 s, 50 ms", Faults(delay_ms=50, cuts=((6, 66),)), least_s=LONG_S),
    Row("encoder killed", _CLEAN, events=_again(ENCODER), least_s=SHORT_S),
    Row("decoder killed", _CLEAN, events=_again(DECODER), least_s=SHORT_S),
    Row("encoder has another address", _CLEAN, events=_moved(ENCODER), least_s=SHORT_S),
    Row("decoder has another address", _CLEAN, events=_moved(DECODER), least_s=SHORT_S),
    Row("relay, 0 %, 50 ms", _CLEAN, relay=True),
    Row("relay, 10 %, 50 ms", _LOSSY, relay=True),
    Row("relay killed", _CLEAN, events=_again(RELAY), least_s=SHORT_S, relay=True),
    Row("relay killed, 10 %, 50 ms", _LOSSY, events=_again(RELAY), least_s=SHORT_S, relay=True),
    Row(
        "SFrame, 5 %, 50 ms", Faults(loss=0.05, delay_ms=50), sframe=True, seeds=3, least_s=SHORT_S
    ),
    Row(
        "SFrame, 25 %, 50 ms", Faults(loss=0.25, delay_ms=50), sframe=True, seeds=3, least_s=SHORT_S
    ),
    Row("0 %, 50 ms, 75 s", _CLEAN, least_s=LONG_S),
    *_with_repairs("TCP", "tcp/{}"),
    *_with_repairs("QUIC, mixed", QUIC),
)
