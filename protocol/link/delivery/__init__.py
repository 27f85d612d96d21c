"""What keeps a call whole over a link that loses, repeats and reorders; no input or output."""
