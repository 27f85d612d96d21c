"""The appearance of a face in the shape-free frame: sampling, visibility, masks, rendering."""
