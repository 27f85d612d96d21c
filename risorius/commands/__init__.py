"""One module for each command or pair of commands: its options, and what it does."""
