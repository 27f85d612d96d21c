"""The picture codec, decoding side: wavelet subbands with a learned context model."""
