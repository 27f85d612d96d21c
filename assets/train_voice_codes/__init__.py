"""The prefix codes of the voice, trained on speech."""
