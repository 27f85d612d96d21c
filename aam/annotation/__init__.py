"""Annotation (thesis 2.4.1): the 3D model fitted to still pictures, and its files."""
