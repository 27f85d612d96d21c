"""A call both ways: one process sends, others draw, and a page shows and steers it."""
