"""How often a face is found where there is none."""
