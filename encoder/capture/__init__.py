"""Frames of a camera or video, and the window of a frame that holds a face."""
