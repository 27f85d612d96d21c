"""The links that calls are measured over, and what happens to their ends meanwhile."""

from dataclasses import dataclass

from loopback.bad_wire import Faults

# Which host is which: the decoder listens, the encoder connects.
DECODER, ENCODER = 0, 1


@dataclass(frozen=True, slots=True)
class Event:
    """Seconds after both ends have been started, a host's process is killed or started again."""

    at_s: float
    host: int
    kills: bool


@dataclass(frozen=True, slots=True)
class Row:
    """A call over one link.

    endpoint: of the decoder, with {} for its host and port.  layers: the model is sent in layers.
    least_s: how long the call lasts at least: its frame packets are sent again after the last one.
    seeds: how many calls there are.
    """

    name: str
    faults: Faults
    endpoint: str = "{}"
    events: tuple[Event, ...] = ()
    layers: bool = False
    least_s: float = 0.0
    seeds: int = 1


def _killed(host: int, at_s: float = 6.0) -> tuple[Event, ...]:
    return Event(at_s, host, kills=True), Event(at_s + 1, host, kills=False)


CLEAN = Row("0 %, 50 ms", Faults(delay_ms=50))
ROWS = (
    CLEAN,
    Row("5 %, 50 ms", Faults(loss=0.05, delay_ms=50), seeds=3),
    Row("10 %, 50 ms", Faults(loss=0.1, delay_ms=50), seeds=3),
    Row("25 %, 50 ms", Faults(loss=0.25, delay_ms=50), seeds=3),
    Row("10 % in bursts of 3, 50 ms", Faults(loss=0.1, burst=3, delay_ms=50), seeds=3),
    Row("0 %, 300 ms", Faults(delay_ms=300)),
    Row("5 %, 300 ms", Faults(loss=0.05, delay_ms=300), seeds=3),
    Row("50 ms +- 50 ms", Faults(delay_ms=50, jitter_ms=50)),
    Row("2 % twice, 50 ms", Faults(duplicates=0.02, delay_ms=50)),
    Row("9.6 kbit/s, 300 ms", Faults(rate_bps=9600, delay_ms=300), layers=True),
    Row("4.8 kbit/s, 300 ms", Faults(rate_bps=4800, delay_ms=300), layers=True),
    Row("cut 6 to 9 s, 50 ms", Faults(delay_ms=50, cuts=((6, 9),)), least_s=11.5),
    Row("cut 6 to 66 s, 50 ms", Faults(delay_ms=50, cuts=((6, 66),)), least_s=75),
    Row(
        "encoder killed, again 1 s later",
        Faults(delay_ms=50),
        events=_killed(ENCODER),
        least_s=11.5,
    ),
    Row(
        "decoder killed, again 1 s later",
        Faults(delay_ms=50),
        events=_killed(DECODER),
        least_s=11.5,
    ),
    Row("0 %, 50 ms, one minute", Faults(delay_ms=50), least_s=60),
    *(
        Row(f"{name}, {loss} %, 50 ms", Faults(loss=loss / 100, delay_ms=50), endpoint)
        for name, endpoint in (("TCP", "tcp/{}"), ("QUIC, mixed", "udp/{}?rel=1;mixed_rel=1"))
        for loss in (0, 5, 25)
    ),
)
