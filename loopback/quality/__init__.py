"""How good a decoded video is beside its source: PSNR, SSIMULACRA2, landmarks."""
