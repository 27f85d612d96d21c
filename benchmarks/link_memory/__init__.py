"""Memory of a long call over a bad link, in simulated time; see `__main__`."""
