"""The CPU time of each stage of both ends, as a multiple of that of fixed work."""
