"""An endpoint of Zenoh in its parts, and why it could not be opened."""

from dataclasses import dataclass
from enum import StrEnum


class Failure(StrEnum):
    """Why a connection could not be opened."""

    UNRESOLVED = "its name is not known"
    UNREACHABLE = "no way leads there"
    REFUSED = "nobody listens there"
    SILENT = "no answer"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One endpoint of Zenoh.  tail: its options, as Zenoh takes them."""

    scheme: str
    host: str
    port: int
    tail: str = ""

    @property
    def is_reliable(self) -> bool:
        """Whether nothing is lost on the way and the set-up repeats itself."""
        return self.scheme != "udp" or "rel=1" in self.tail

    def at(self, host: str) -> str:
        """The endpoint with another host, for Zenoh."""
        bracketed = f"[{host}]" if ":" in host and not host.startswith("[") else host
        return f"{self.scheme}/{bracketed}:{self.port}{self.tail}"

    def __str__(self) -> str:
        return self.at(self.host)
