"""Whole calls: three sessions that turn the frames of a source into packets, and their parts."""
