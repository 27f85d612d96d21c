"""What is drawn of a frame: a model's pictures, the face in motion, the layers around it."""
