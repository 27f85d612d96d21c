"""How the layers of the picture move: the person and the scene behind."""
