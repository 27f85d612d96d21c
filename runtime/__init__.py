"""What makes inner loops fast, for both ends."""
