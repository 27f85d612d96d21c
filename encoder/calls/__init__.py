"""Whole calls: what is learned, announced and sent when."""
