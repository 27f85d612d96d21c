"""What has been sent of a face, in words, from the packets."""

from protocol.packets import PacketKind, packet_kind


class SentFace:
    """Gets every packet of a live call.

    preparing: what the encoder prepares before it looks for a face; "": nothing.
    words: for the user.
    """

    def __init__(self) -> None:
        self.preparing = ""
        self._models = self._details = 0

    def add(self, packet: bytes) -> None:
        """Take a serialised packet."""
        kind = packet_kind(packet)
        if kind is PacketKind.MODEL:
            self._models += 1
        elif kind is PacketKind.LAYER:
            self._details += 1

    @property
    def words(self) -> str:
        """See the class."""
        if not self._models:
            return self.preparing or "looking for your face"
        times = "" if self._models == 1 else f" {self._models} times"
        return f"face learned{times}, {self._details} details"
