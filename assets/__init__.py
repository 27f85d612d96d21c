"""What makes the data that both ends hold: the head, its texture atlas, tables of probabilities."""
