"""Where an encoder's packets go: a call file, a stream or the network."""

from contextlib import ExitStack
from pathlib import Path

from encoder.options import EncodeOptions
from protocol.call_file import CallStreamWriter, CallWriter
from protocol.link.interface import (
    CONNECT_TIMEOUT_S,
    LinkOptions,
    MessageCallback,
    PacketSink,
)


def open_packet_sink(
    options: EncodeOptions, stack: ExitStack, on_message: MessageCallback
) -> PacketSink:
    """The sink for `options`, closed with `stack`.

    on_message: see `SessionCallbacks`.
    Raises `UserError` if it cannot be written, or nobody is there within the time to wait.
    """
    if isinstance(options.output, Path):
        return stack.enter_context(CallWriter(options.output))
    if options.output is not None:
        return stack.enter_context(CallStreamWriter(options.output))
    # Only now: a host that writes call files needs no network library.
    from protocol.link.zenoh_link import ZenohSink

    timeout_s = options.wait_for_peer_s or CONNECT_TIMEOUT_S
    link = LinkOptions(
        options.call,
        options.listen,
        options.connect,
        timeout_s,
        options.lossless,
        security=options.security,
    )
    sink = stack.enter_context(ZenohSink(link, on_message))
    if options.wait_for_peer_s:
        sink.wait_for_peer(options.wait_for_peer_s)
    return sink
