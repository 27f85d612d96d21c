"""What each codec leaves of a voice, and what it takes for it."""
