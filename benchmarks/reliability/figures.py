"""Figures of a measured call, from the logs of its ends."""

import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.simulated_link import SentPacket
from decoder.playout.playout import PlayoutFrame
from decoder.playout.receiver import Receiver
from decoder.scene.decoded_model import face_from_model, head_of
from protocol.link.interface import Arrival
from protocol.packets import PacketKind, packet_kind
from shared_model.geometry import pixel_from_head

Line = dict[str, Any]


def read_log(path: Path) -> list[Line]:
    """The lines of an end's log; one that was killed may have left half a line."""
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines if line.endswith("}")]


def ways_ms(sender: Sequence[Line], receiver: Sequence[Line]) -> list[float | None]:
    """One-way time of each frame packet of one start of each end; None: it never came."""
    sent = {line["number"]: line["t"] for line in sender if line["what"] == "sent"}
    came = {line["number"]: line["t"] for line in receiver if _is_frame(line)}
    return [1000 * (came[n] - sent[n]) if n in came else None for n in sent]


def percentile(values: Sequence[float | None], share: float) -> float:
    """Of times of which None is longer than all."""
    finite = [float("inf") if value is None else value for value in values]
    return sorted(finite)[min(int(share * len(finite)), len(finite) - 1)]


def arrivals_of(receiver: Sequence[Line]) -> list[Arrival]:
    """What the decoder's end of the link gave out."""
    return [
        Arrival(bytes.fromhex(line["data"]), line["t"], line["session"], line["number"])
        for line in receiver
        if line["what"] == "came"
    ]


def back_after_s(receiver: Sequence[Line], since_s: float) -> float:
    """How long after a time the first frame packet came that is newer than all before."""
    newest = max((_order(x) for x in receiver if _is_frame(x) and x["t"] <= since_s), default=None)
    later = [x for x in receiver if _is_frame(x) and x["t"] > since_s]
    fresh = [x["t"] - since_s for x in later if newest is None or _order(x) > newest]
    return min(fresh, default=float("inf"))


def _order(line: Line) -> tuple[int, int]:
    return line["session"], line["number"]


def _is_frame(line: Line) -> bool:
    is_packet = line["what"] == "came"
    return is_packet and packet_kind(bytes.fromhex(line["data"])) is PacketKind.FRAME


def played(arrivals: Sequence[Arrival]) -> tuple[list[PlayoutFrame], float]:
    """What a decoder shows of arrivals, and when the first picture can be drawn."""
    receiver = Receiver(on_damage=lambda error: None)
    shown, first_s, now_s = list[PlayoutFrame](), float("inf"), float("-inf")
    for arrival in arrivals:
        # Frame packets that came before the model have waited for it.
        now_s = max(now_s, arrival.time_s)
        while (due_s := receiver.release_s) is not None and due_s < arrival.time_s:
            shown += receiver.poll(due_s)
        shown += receiver.receive(arrival)
        if shown:
            first_s = min(first_s, now_s)
    while (due_s := receiver.release_s) is not None:
        shown += receiver.poll(due_s)
    return shown, first_s


def largest_step_px(shown: Sequence[PlayoutFrame]) -> float:
    """The farthest that a point of the face moves from one picture to the next."""
    if not shown:
        return 0.0
    model = shown[0].model
    face, camera = face_from_model(model, head_of(model)), model.call.camera
    points = face.at_vertices(np.arange(0, len(face.neutral), 7))
    places = [
        pixel_from_head(camera, each.face.pose, points.animate(each.face.eau)) for each in shown
    ]
    steps = [np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(places)]
    return float(max(steps, default=0.0))


def clean_arrivals(sent: Sequence[SentPacket]) -> list[Arrival]:
    """The packets as a link without faults gives them out."""
    return [Arrival(each.data, each.sent_s, 0, each.number) for each in sent]
