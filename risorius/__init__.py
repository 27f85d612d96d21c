"""The command line and what people use by themselves; thin."""
