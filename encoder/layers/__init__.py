"""The layers around the face: the scene, and the person before it, learned from a sample."""
