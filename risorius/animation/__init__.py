"""Key-framed faces with their ground truth."""
