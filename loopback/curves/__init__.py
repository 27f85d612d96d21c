"""Rate and quality: our curve, those of other codecs on the same frames, and where they cross."""
