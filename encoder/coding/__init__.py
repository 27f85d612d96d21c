"""Rate-distortion coding: from fitted faces and a person model to packets at a given rate."""
