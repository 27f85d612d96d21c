"""The figures of a clip: which tables show them, which have a mean, of which less is better.

A figure has the name of the field of `Comparison`, or of one of its parts, or of the line of
`CALL_FIGURES` that it is.  Tables and means are in this order.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Figure:
    """How a figure is shown.

    name: dotted if it is one of several, as in `latency_ms.p50`.
    label: in the table of `risorius compare`, with its unit; None: it is not there.
    column: its heading in the table of `risorius bench`; None: it is not there.
    is_averaged: it has a mean over clips.
    """

    name: str
    label: str | None = None
    column: str | None = None
    is_averaged: bool = False
    less_is_better: bool = False


FIGURES = (
    Figure("source", column="clip"),
    Figure("frames", column="frames"),
    Figure("call_bytes", "call file, bytes", less_is_better=True),
    Figure(
        "model_bytes", "  models in it", column="model B", is_averaged=True, less_is_better=True
    ),
    Figure("frame_bytes", less_is_better=True),
    Figure(
        "frame_bps",
        "  frame packets, bits a second",
        column="bps",
        is_averaged=True,
        less_is_better=True,
    ),
    Figure("face_psnr_db", "PSNR of the face, dB", column="face dB", is_averaged=True),
    Figure("face_psnr_p5_db", "  its 5th percentile", column="p5", is_averaged=True),
    Figure("full_psnr_db", "PSNR of the picture, dB", column="picture", is_averaged=True),
    Figure("full_psnr_p5_db", "  its 5th percentile"),
    Figure(
        "person_psnr_db",
        "PSNR of the person but for the face, dB",
        column="person",
        is_averaged=True,
    ),
    Figure("background_psnr_db", "PSNR of what is behind, dB", column="behind", is_averaged=True),
    Figure("face_ssim", "SSIM of the face"),
    Figure("full_ssim", "SSIM of the picture"),
    Figure("face_ssimulacra2", "SSIMULACRA2 of the face", column="SSIMU2 face", is_averaged=True),
    Figure("blink_ssimulacra2", "  in frames of blinks", column="of blinks", is_averaged=True),
    Figure(
        "picture_ssimulacra2", "SSIMULACRA2 of the picture", column="of picture", is_averaged=True
    ),
    Figure("vmaf", "VMAF"),
    Figure("lpips", "LPIPS", less_is_better=True),
    Figure("dists", "DISTS", less_is_better=True),
    Figure(
        "flicker_ratio",
        "flicker of what is behind, decoded over source",
        is_averaged=True,
        less_is_better=True,
    ),
    Figure(
        "nme_percent",
        "landmarks apart, % of the eyes' distance",
        column="nme %",
        is_averaged=True,
        less_is_better=True,
    ),
    Figure("face_found", "share of the faces that are found again", is_averaged=True),
    Figure("mouth_corr", "correlation of the mouth's opening", column="mouth", is_averaged=True),
    Figure(
        "mouth_mae_percent", "  its mean difference, % of the eyes' distance", less_is_better=True
    ),
    Figure("brow_corr", "correlation of the brows' height", is_averaged=True),
    Figure("blink_corr", "correlation of the eyes' opening", column="blink", is_averaged=True),
    Figure(
        "jitter_ratio",
        "restlessness of the landmarks, decoded over source",
        is_averaged=True,
        less_is_better=True,
    ),
    Figure("overloaded_frames", is_averaged=True, less_is_better=True),
    Figure("identity", "likeness for a face recogniser, cosine", is_averaged=True),
    Figure(
        "emotion_agreement",
        "share of the frames that show the same emotion",
        column="emotion",
        is_averaged=True,
    ),
    Figure("yaw_mae_deg", "yaw apart, degrees", less_is_better=True),
    Figure("pitch_mae_deg", "pitch apart, degrees", less_is_better=True),
    Figure("roll_mae_deg", "roll apart, degrees", less_is_better=True),
    Figure("voice_estoi", "ESTOI of the voice"),
    Figure("voice_late_ms", "  by how much it is late, ms", less_is_better=True),
    Figure("voice_dnsmos", "DNSMOS of the voice"),
    Figure("source_dnsmos", "  of the source"),
    Figure("latency_ms.p50", column="lat p50 ms", less_is_better=True),
    Figure("latency_ms.p99", column="p99", less_is_better=True),
    Figure("encoder_fps", column="enc fps"),
    Figure("decoder_fps", column="dec fps"),
    Figure("encoder_ms", less_is_better=True),
    Figure("decoder_ms", less_is_better=True),
    Figure("encoder_cpu_ms", less_is_better=True),
    Figure("decoder_cpu_ms", less_is_better=True),
    Figure("encoder_frame_ms", less_is_better=True),
    Figure("decoder_frame_ms", less_is_better=True),
    Figure("overload_levels", less_is_better=True),
    Figure("omitted_frames", less_is_better=True),
    Figure("worst_lag_ms", less_is_better=True),
    Figure("skipped_frames", less_is_better=True),
    Figure("lost_packets", less_is_better=True),
    Figure("lost_frames", less_is_better=True),
)


def less_is_better(name: str) -> bool:
    """Of a figure by its dotted name; of all that are not in `FIGURES` more is."""
    heads = name, name.partition(".")[0]
    return any(each.less_is_better for each in FIGURES if each.name in heads)
