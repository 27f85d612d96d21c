"""The face from frame to frame."""
