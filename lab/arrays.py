"""Type aliases of NumPy arrays, defined once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Marked = npt.NDArray[np.uint8]  # mask of zeros and ones for OpenCV, shape (height, width)
Image = npt.NDArray[np.uint8]  # shape (height, width, 3), BGR, or (height, width)
GreyImage = npt.NDArray[np.uint8]  # shape (height, width)
FloatImage = npt.NDArray[np.float32]  # shape (height, width) or (height, width, 3), brightness or coordinates [px]
