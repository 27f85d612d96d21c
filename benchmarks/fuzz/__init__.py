"""What damaged bytes do to a receiver; see `__main__`."""
