"""The face tracked from frame to frame."""
