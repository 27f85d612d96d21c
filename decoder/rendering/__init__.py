"""Drawing with OpenGL: the background, then the head."""
