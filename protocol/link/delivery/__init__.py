"""What keeps a call whole over a link that loses, repeats and reorders; without input and output.

With `messages`, `plain_protection` and `connection` the core of a link over raw UDP.  `zenoh_link`
does not use them yet.
"""
