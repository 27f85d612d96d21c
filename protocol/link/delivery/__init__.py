"""What keeps a call whole over a link that loses, repeats and reorders; sans-IO."""
