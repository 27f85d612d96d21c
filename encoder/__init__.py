"""From pictures to packets: detect, fit, track, code."""
