"""What a report shows of a clip: pictures side by side, quality and bits by time."""

import base64
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from loopback.call_packets import call_packets
from loopback.curves.contenders import ClipPictures, decoded_call
from loopback.curves.points import Point
from loopback.curves.rivals import Rival, RivalSetting, code, decoded, scaled_size, shrunk
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.video_quality import in_source_pixels
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket
from runtime.image_ops import jpeg
from shared_model.arrays import Picture

# Times at which pictures are shown, and their longer side, pixels.
SHOWN, LONGER_SIDE = 6, 480
JPEG_QUALITY = 85
# An error map shows so many times the difference.
ERROR_GAIN = 4


@dataclass(frozen=True, slots=True)
class Exhibit:
    """One codec on one clip.

    title: codec and setting.  pictures: data URLs, at the shown times; errors: likewise, of the
        difference; empty: it is the source.
    face_psnr_db: of each frame, None where the source shows no face.
    kilobytes: (second, sent so far) in order.
    """

    title: str
    pictures: tuple[str, ...]
    errors: tuple[str, ...] = ()
    face_psnr_db: tuple[float | None, ...] = ()
    kilobytes: tuple[tuple[float, float], ...] = ()


def shown_frames(count: int) -> list[int]:
    """Numbers of the frames that are shown of so many."""
    return [round(place) for place in np.linspace(0, count - 1, min(SHOWN, count))]


def source_exhibit(clip: ClipPictures) -> Exhibit:
    """The source itself."""
    shown = shown_frames(len(clip.pictures))
    return Exhibit("source", tuple(_data_url(clip.pictures[number]) for number in shown))


def own_exhibit(title: str, call: Path, clip: ClipPictures) -> Exhibit:
    """A call file of ours."""
    with decoded_call(call) as copies:
        return _exhibit(title, copies, clip, list(_sent(call, clip)))


def rival_exhibit(rival: Rival, setting: RivalSetting, title: str, clip: ClipPictures) -> Exhibit:
    """A rival, coded once more."""
    size = scaled_size(clip.view.size, setting.scale)
    assert size is not None
    packets = code(rival, setting, shrunk(clip.pictures[:: setting.frame_step], size), clip.fps)
    sent = np.cumsum([packet.size for packet in packets]) / 1000
    seconds = np.arange(len(packets)) * setting.frame_step / float(clip.fps)
    copies = decoded(rival, packets, setting.frame_step, clip.view.size)
    return _exhibit(title, copies, clip, list(zip(seconds.tolist(), sent.tolist(), strict=True)))


def nearest_point(points: Sequence[Point], bps: float, duration_s: float) -> Point | None:
    """The point of the highest rate up to `bps`; where all are above, that of the lowest rate."""
    if not points:
        return None
    rising = sorted(points, key=lambda point: point.total_bps(duration_s))
    below = [point for point in rising if point.total_bps(duration_s) <= bps]
    return below[-1] if below else rising[0]


def _exhibit(
    title: str,
    copies: Iterable[Picture],
    clip: ClipPictures,
    sent: Sequence[tuple[float, float]],
) -> Exhibit:
    shown, masks = shown_frames(len(clip.pictures)), clip.view.face_masks()
    pictures, errors, psnr = list[str](), list[str](), list[float | None]()
    for number, (original, copy) in enumerate(zip(clip.pictures, copies, strict=False)):
        mask = in_source_pixels(masks, original, clip.view.aspect)
        has_face = mask is not None and bool(mask.any())
        error = squared_error(original, copy)
        psnr.append(round(psnr_db(error[mask]), 2) if has_face else None)
        if number in shown:
            pictures.append(_data_url(copy))
            apart = np.clip(ERROR_GAIN * np.sqrt(error), 0, 255).astype(np.uint8)
            errors.append(_data_url(cv2.cvtColor(apart, cv2.COLOR_GRAY2BGR)))
    return Exhibit(title, tuple(pictures), tuple(errors), tuple(psnr), tuple(sent))


def _sent(call: Path, clip: ClipPictures) -> Iterator[tuple[float, float]]:
    """(second, kilobytes sent so far) after each packet of a call file."""
    total, frame, per_packet = 0, 0, 1
    for packet, size in call_packets(call):
        if isinstance(packet, ModelPacket):
            per_packet = packet.call.frames_per_packet * packet.call.frame_step
            frame = max(frame, packet.call.start_frame)
        frame += per_packet * isinstance(packet, FramePacket)
        total += size
        yield min(frame / float(clip.fps), clip.seconds), total / 1000


def _data_url(picture: Picture) -> str:
    ratio = min(1.0, LONGER_SIDE / max(picture.shape[:2]))
    small = cv2.resize(picture, None, fx=ratio, fy=ratio, interpolation=cv2.INTER_AREA)
    data = jpeg(np.asarray(small, np.uint8), JPEG_QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"
