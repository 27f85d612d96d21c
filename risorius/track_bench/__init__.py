"""What the tracker finds against what was measured or labelled: poses, action units."""
