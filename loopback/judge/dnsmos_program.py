"""What the judge's environment runs for a voice: DNSMOS (Reddy et al. 2022).

dnsmos_program.py < 16 kHz float32 samples > JSON
"""

import json
import sys
from typing import Any

import numpy as np
from speechmos import dnsmos

RATE_HZ = 16_000
# Of what the network of P.808 takes: frames, bands.
SPECTRUM = 900, 120


def without_spectrum(*arguments: Any, **options: Any) -> Any:
    """Nothing, for P.808, of which nothing is told: librosa would compile loops for seconds."""
    return np.zeros(SPECTRUM)


def main() -> None:
    samples = np.frombuffer(sys.stdin.buffer.read(), np.float32)
    dnsmos.DNSMOS.audio_melspec = without_spectrum
    found = dnsmos.run(samples.clip(-1, 1), sr=RATE_HZ)
    told = {name: float(value) for name, value in found.items() if name != "p808_mos"}
    print(json.dumps(told))


if __name__ == "__main__":
    main()
