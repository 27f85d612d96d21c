"""Who is in the picture: which of several faces is followed, and whether it is still the same."""
