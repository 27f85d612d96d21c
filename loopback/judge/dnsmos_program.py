"""What the judge's environment runs for a voice: DNSMOS (Reddy et al. 2022).

dnsmos_program.py < 16 kHz float32 samples > JSON
"""

import json
import sys

import numpy as np
from speechmos import dnsmos

RATE_HZ = 16_000


def main() -> None:
    samples = np.frombuffer(sys.stdin.buffer.read(), np.float32)
    found = dnsmos.run(samples.clip(-1, 1), sr=RATE_HZ)
    print(json.dumps({name: float(value) for name, value in found.items()}))


if __name__ == "__main__":
    main()
