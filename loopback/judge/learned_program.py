"""What the judge's environment runs for LPIPS and DISTS: a network of the user's, by ONNX Runtime.

    learned_program.py MODEL.onnx WIDTH HEIGHT LOW < pairs of BGR frames > mean

The network takes two pictures (1, 3, h, w) float32 RGB, LOW to 1, and gives one number for them.
"""

import sys

import numpy as np
import onnxruntime


def main() -> None:
    path, width, height, low = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = [each.name for each in session.get_inputs()]
    if len(names) != 2:
        sys.exit(f"{path} takes {len(names)} inputs, expected two pictures")
    size, found = width * height * 3, []
    while len(data := sys.stdin.buffer.read(2 * size)) == 2 * size:
        pair = np.frombuffer(data, np.uint8).reshape(2, height, width, 3)
        scaled = pair[..., ::-1].transpose(0, 3, 1, 2).astype(np.float32) / 255
        scaled = low + (1 - low) * scaled
        pictures = {name: scaled[i : i + 1] for i, name in enumerate(names)}
        found.append(float(np.mean(session.run(None, pictures)[0])))
    print(float(np.mean(found)))


if __name__ == "__main__":
    main()
