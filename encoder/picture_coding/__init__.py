"""The encoder of wavelet pictures: quantisation, entropy coding, pictures within a size."""
