"""The picture codec, encoding side: quantise and code pictures within a size."""
