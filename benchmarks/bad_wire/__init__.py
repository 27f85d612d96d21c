"""Measures calls over a bad wire; see `__main__`."""
