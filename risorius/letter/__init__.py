"""A letter: a call and what plays it, in one HTML file."""
