"""Whether a link is so thin that the model of a call has to be sent in layers, and at what rate."""

# A link that carries less is thin: there a model of 10 kB takes more than a second.
THIN_BPS = 64_000.0
# Share of a thin link that a call takes, so that no packet waits for long.
USED_SHARE = 0.7
# Bytes of IP, UDP, Zenoh and of the link itself around a frame packet and around a layer packet.
FRAME_OVERHEAD_BYTES, LAYER_OVERHEAD_BYTES = 45, 60
# The smallest layer packet, so that what is around it stays a small share.
LAYER_BYTES = 256
# What is left for the model at least, beside the frame packets, as a share of their rate.
LEAST_SHARE = 0.25


def startup_rate(
    link_bps: float | None,
    limit_bps: float | None,
    frames_bps: float,
    packets_per_s: float,
) -> float | None:
    """Bits per second of all packets while the model is sent in layers; None: send it whole.

    link_bps: what the link carries, with all its headers; None: not known.
    limit_bps: what the user allows, of packets without headers; None: anything.
    frames_bps: of the frame packets, of which `packets_per_s` are sent.
    """
    if link_bps is None or link_bps >= THIN_BPS:
        return limit_bps
    free_bps = USED_SHARE * link_bps - 8 * FRAME_OVERHEAD_BYTES * packets_per_s - frames_bps
    model_bps = free_bps * LAYER_BYTES / (LAYER_BYTES + LAYER_OVERHEAD_BYTES)
    rate_bps = frames_bps + max(model_bps, LEAST_SHARE * frames_bps)
    return rate_bps if limit_bps is None else min(rate_bps, limit_bps)
