"""Types of arrays, named by what they hold; their shapes stand where they are used."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Integers = NDArray[np.int64]
Indices = NDArray[np.intp]
VertexIndices = NDArray[np.int32]
Samples = NDArray[np.int16]
