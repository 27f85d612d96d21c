"""Error near a person's outline."""
