"""Speech frames on the wire: what a frame packet of a call with a voice has before the face."""
