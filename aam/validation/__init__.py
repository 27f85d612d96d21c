"""Validation (thesis 3): the experiments of the thesis, and a 2D AAM to compare with."""
