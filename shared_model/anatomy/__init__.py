"""The anatomy of the head: muscles, jaw, eyelids, expressions and body measurements."""
