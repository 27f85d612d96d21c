"""Where an encoder's packets go: a call file, a stream or the network."""

from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO

from encoder.options import EncodeOptions
from protocol.call_file import CallStreamWriter, CallWriter
from protocol.link.carriers import open_link_sink
from protocol.link.interface import LinkQuality, MessageCallback, PacketSink, Reachability


def open_packet_sink(
    options: EncodeOptions, stack: ExitStack, on_message: MessageCallback
) -> PacketSink:
    """The sink for `options`, with a copy for its monitor, closed with `stack`.

    on_message: see `SessionCallbacks`.
    Raises `UserError` if it cannot be written, or there is no link.
    """
    sink = _open_packet_sink(options, stack, on_message)
    return sink if options.monitor is None else MonitoredSink(sink, options.monitor)


def _open_packet_sink(
    options: EncodeOptions, stack: ExitStack, on_message: MessageCallback
) -> PacketSink:
    if isinstance(options.output, Path):
        return stack.enter_context(CallWriter(options.output))
    if options.output is not None:
        return stack.enter_context(CallStreamWriter(options.output))
    if options.link is None:
        raise ValueError("options have neither output nor link, expected one of them")
    return stack.enter_context(open_link_sink(options.link, on_message))


class ForwardingSink(PacketSink):
    """A `PacketSink` that sends to another one and is in its state."""

    def __init__(self, sink: PacketSink) -> None:
        self._sink = sink

    @property
    def reachability(self) -> Reachability:
        """That of the other sink."""
        return self._sink.reachability

    @property
    def quality(self) -> LinkQuality:
        """That of the other sink."""
        return self._sink.quality

    def wait_for_peer(self, timeout_s: float) -> None:
        """Wait for a decoder of the other sink."""
        self._sink.wait_for_peer(timeout_s)

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        self._sink.send(packet)

    def close(self) -> None:
        """Close the other sink."""
        self._sink.close()


class MonitoredSink(ForwardingSink):
    """A `PacketSink` that sends each packet to another one and writes it to an open stream.

    A stream that cannot be written any more gets nothing further: the call goes on.  It stays open.
    """

    def __init__(self, sink: PacketSink, monitor: BinaryIO) -> None:
        super().__init__(sink)
        self._copy: CallStreamWriter | None = None
        with suppress(OSError):
            self._copy = CallStreamWriter(monitor)

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        super().send(packet)
        if self._copy is None:
            return
        try:
            self._copy.send(packet)
        except OSError:
            self._copy = None
