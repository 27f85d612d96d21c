"""Sources of video frames, their luma, and the window of a frame that holds the face."""
