"""Action units: faces that show them, and their recognition (3.2)."""
