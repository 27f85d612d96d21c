"""What lost frame packets cost: python -m benchmarks loss_table CALL SOURCE [--seeds N]

Loses frame packets of the call file CALL by seeded patterns, plays out what arrives, and prints how
much lower the PSNR of the face is than that of the whole call, dB, against the video SOURCE:

nothing: what is lost never comes.  heal: it is sent again, but never waited for.  wait: it is
waited for as a decoder does.  copy: each packet has a copy of the one before, and nothing is sent
again; that takes half of the rate, so that a call of half the rate is to be compared.  shown late:
the share of packets that came after their frames were shown.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.command import run
from benchmarks.simulated_link import SentPacket, SimulatedLink, arrivals, sent_packets
from decoder.playout.playout import PlayoutFrame
from decoder.playout.receiver import Receiver
from decoder.scene.decoded_model import decoded_model
from decoder.scene.scene import Scene
from encoder.capture.video_source import open_source
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.video_quality import TrackedFaceMask
from loopback.report import Cell, table
from protocol.link.interface import Arrival
from shared_model.arrays import Mask, Picture
from shared_model.stage_timer import StageTimer

LINKS = {
    "0 %": SimulatedLink(),
    "5 %": SimulatedLink(loss=0.05),
    "10 %": SimulatedLink(loss=0.1),
    "25 %": SimulatedLink(loss=0.25),
    "10 % in threes": SimulatedLink(loss=0.1, burst=3),
    "25 % in threes": SimulatedLink(loss=0.25, burst=3),
    "5 %, 300 ms": SimulatedLink(loss=0.05, delay_s=0.3),
    "jitter 50 ms": SimulatedLink(jitter_s=0.05, duplicates=0.02),
}
# Whether lost packets come again, whether they are waited for, and in how many packets each is.
MODES = {
    "nothing": (False, False, 1),
    "heal": (True, False, 1),
    "wait": (True, True, 1),
    "copy": (False, True, 2),
}


class FacePsnr:
    """PSNR of faces against their source pictures; equal faces are drawn once."""

    def __init__(self, source: str, frames: int) -> None:
        find = TrackedFaceMask()
        with open_source(source) as capture:
            self._originals = [picture for index, picture in capture if index < frames]
        self._masks = [find(picture) for picture in self._originals]
        self._known: dict[int, list[tuple[PlayoutFrame, float]]] = {}
        self._scene: Scene | None = None

    def mean_db(self, played: Sequence[PlayoutFrame]) -> float:
        """Mean over the frames whose source shows a face."""
        found = [self._psnr_db(each) for each in played if each.index < len(self._masks)]
        return float(np.nanmean(found))

    def close(self) -> None:
        """Free the renderer."""
        if self._scene is not None:
            self._scene.close()

    def _psnr_db(self, frame: PlayoutFrame) -> float:
        mask = self._masks[frame.index]
        if mask is None:
            return float("nan")
        known = self._known.setdefault(frame.index, [])
        for other, figure in known:
            if _is_same(other, frame):
                return figure
        known.append((frame, self._drawn_db(frame, self._originals[frame.index], mask)))
        return known[-1][1]

    def _drawn_db(self, frame: PlayoutFrame, original: Picture, mask: Mask) -> float:
        if self._scene is None or self._scene.model is not frame.model:
            self.close()
            self._scene = Scene(decoded_model(frame.model))
        picture = self._scene.draw(frame.face, StageTimer())
        return psnr_db(squared_error(original, picture)[mask])


def _is_same(one: PlayoutFrame, other: PlayoutFrame) -> bool:
    pairs = (
        (one.face.eau, other.face.eau),
        (one.face.modes, other.face.modes),
        (one.face.layers, other.face.layers),
        (one.face.pose.rotation, other.face.pose.rotation),
        (one.face.pose.translation_mm, other.face.pose.translation_mm),
    )
    return all(np.array_equal(first, second) for first, second in pairs)


def play(receiver: Receiver, arriving: Sequence[Arrival]) -> Iterator[PlayoutFrame]:
    """The frames of the call, each when it is due."""
    for arrival in arriving:
        while (due_s := receiver.release_s) is not None and due_s < arrival.time_s:
            yield from receiver.poll(due_s)
        yield from receiver.receive(arrival)
    while (due_s := receiver.release_s) is not None:
        yield from receiver.poll(due_s)


def main(argv: Sequence[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="loss_table", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("call", type=Path, metavar="CALL")
    parser.add_argument("source", metavar="SOURCE")
    parser.add_argument("--seeds", type=int, default=4, metavar="N", help="patterns for each row")
    options = parser.parse_args(argv)
    sent = sent_packets(options.call)
    clean = list(play(Receiver(), arrivals(sent, SimulatedLink(), 0)))
    faces = FacePsnr(options.source, len(clean))
    try:
        clean_db = faces.mean_db(clean)
        print(f"{options.call}: {clean_db:.2f} dB")
        header = ("link", *MODES, "concealed", "shown late")
        rows = [
            _row(name, sent, link, faces, clean_db, options.seeds) for name, link in LINKS.items()
        ]
        print(table(header, rows))
    finally:
        faces.close()


def _row(
    name: str,
    sent: Sequence[SentPacket],
    link: SimulatedLink,
    faces: FacePsnr,
    clean_db: float,
    seeds: int,
) -> list[Cell]:
    cells: list[Cell] = [name]
    for repeats, waits, copies in MODES.values():
        change = list[float]()
        lost = late = 0
        for seed in range(seeds):
            receiver = Receiver() if waits else Receiver(max_wait_s=0.0)
            lossy = replace(link, repeats=repeats, loss=link.loss**copies)
            shown = list(play(receiver, arrivals(sent, lossy, seed)))
            change.append(faces.mean_db(shown) - clean_db)
            lost += sum(each.lost for each in shown)
            late += receiver.counts.late
        cells.append(round(float(np.mean(change)), 2))
    return [*cells, f"{lost / seeds:.1f}", f"{late / seeds:.1f}"]


if __name__ == "__main__":
    run(main)
