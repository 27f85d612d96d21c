"""From what a link delivers, in any order and with gaps, to the faces of a call."""
