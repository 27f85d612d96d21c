"""Leaf helpers: compiled loops, threads."""
