"""What watching pages cost the relay that serves them, by their number."""
