"""Interlaced pictures as whole ones, one for each, by a filter graph of FFmpeg."""

from collections.abc import Iterator

import av
from av.filter import Graph
from av.video.frame import VideoFrame

# One picture for each; what is progressive in between stays as it is.
FILTER, OPTIONS = "bwdif", "mode=send_frame:parity=auto:deint=interlaced"


class Deinterlacer:
    """Takes frames in order and gives as many back, some later; a size of its own begins anew."""

    def __init__(self) -> None:
        self._graph: Graph | None = None
        self._format: tuple[int, int, str] | None = None

    def add(self, frame: VideoFrame) -> Iterator[VideoFrame]:
        """The frames that are ready after this one."""
        shape = frame.width, frame.height, frame.format.name
        if self._graph is None or shape != self._format:
            yield from self.rest()
            self._graph, self._format = _graph(frame), shape
        self._graph.vpush(frame)
        yield from self._ready()

    def rest(self) -> Iterator[VideoFrame]:
        """The frames that are left after the last one."""
        if self._graph is None:
            return
        self._graph.vpush(None)
        yield from self._ready()
        self._graph = None

    def _ready(self) -> Iterator[VideoFrame]:
        assert self._graph is not None
        while True:
            try:
                yield self._graph.vpull()
            except (av.BlockingIOError, av.EOFError):
                return


def _graph(frame: VideoFrame) -> Graph:
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width,
        height=frame.height,
        format=frame.format,
        time_base=frame.time_base,
    )
    graph.link_nodes(source, graph.add(FILTER, OPTIONS), graph.add("buffersink")).configure()
    return graph
