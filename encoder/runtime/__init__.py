"""Helpers below all other packages of the encoder: compiled loops, thread pools, images."""
