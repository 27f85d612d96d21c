"""The shape-free frame: textures sampled from pictures, texel by texel."""
