"""The thesis profile: the face tracked from frame to frame, and a call of it."""
