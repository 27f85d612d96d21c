"""Entropy coding: range coder, adaptive models, checked reading of bytes."""
