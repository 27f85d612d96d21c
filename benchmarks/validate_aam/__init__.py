"""The experiments of the thesis (2.4.4, 3) on annotated faces; see `__main__`."""
