"""Share of grains, base and vessel in every pixel of a photo, by a small convolutional network.

`training/grain_classes/README.md` says what it was trained on and how well it does, decision 0012 where it fails.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from rigtwin.lab.arrays import FloatImage, Image, Mask

MODEL = Path(__file__).with_name("grain_classes.onnx")
LONGEST = 384  # [px], longer side of the picture that the network sees: about that of its training pictures
CLOSER = 0.8  # share of the picture below which the part with the grains is seen again
MARGIN = 0.3  # of that part's longer side, added on each side
STEP = 32  # [px], sides must be multiples: the network halves the picture five times


class Grain(IntEnum):
    """Classes of pixels, in the order of the network's scores."""

    OTHER = 0
    GRAINS = 1
    BASE = 2  # what the grains stand on: a disc, the foot of a cylinder
    VESSEL = 3  # glass without grains behind it


def grain_classes(image: Image) -> FloatImage:
    """Probabilities of the classes `Grain`.

    Parameters
    ----------
    image : array, shape (height, width, 3), uint8
        Photo in BGR order.

    Returns
    -------
    array, shape (height, width, 4), float32
        Probability of every class; they add up to 1 in every pixel.

    Notes
    -----
    The network sees the picture with a longer side of 384 pixels, and mirrored, and its mean answer has half that
    resolution.  It then sees the part around the grains alone, if that is much less than the picture.
    """
    shares = _seen(image)
    part = _around_grains(shares)
    if part is not None:
        shares[part] = _seen(image[part])
    return shares


def most_grains(classes: FloatImage) -> Mask | None:
    """The connected region of grains and base with most grains, from `grain_classes`; None without any grains."""
    kind = np.argmax(classes, axis=2)
    grains = kind == Grain.GRAINS
    if not grains.any():
        return None
    # a gap of two pixels parts nothing
    joined = cv2.dilate((grains | (kind == Grain.BASE)).astype(np.uint8), np.ones((5, 5), np.uint8))
    _, label = cv2.connectedComponents(joined)
    return np.asarray(label == 1 + int(np.argmax(np.bincount(label[grains])[1:])))


def _around_grains(shares: FloatImage) -> tuple[slice, slice] | None:
    """Rows and columns around the largest region of grains and base, None if they are most of the picture."""
    region = most_grains(shares)
    if region is None:
        return None
    left, top, width, height = cv2.boundingRect(region.astype(np.uint8))
    margin = round(MARGIN * max(width, height))
    rows = slice(max(top - margin, 0), min(top + height + margin, shares.shape[0]))
    columns = slice(max(left - margin, 0), min(left + width + margin, shares.shape[1]))
    longer = max(rows.stop - rows.start, columns.stop - columns.start)
    return (rows, columns) if longer < CLOSER * max(shares.shape[:2]) else None


def _seen(image: Image) -> FloatImage:
    tall, wide = image.shape[:2]
    zoom = min(1.0, LONGEST / max(tall, wide))
    size = max(round(zoom * wide), 1), max(round(zoom * tall), 1)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    below, right = -size[1] % STEP, -size[0] % STEP
    padded = cv2.copyMakeBorder(small, 0, below, 0, right, cv2.BORDER_REPLICATE)
    network = _network()
    both = [padded, np.ascontiguousarray(padded[:, ::-1])]
    network.setInput(cv2.dnn.blobFromImages(both, 1 / 255, mean=(127.5, 127.5, 127.5)))
    first, second = np.asarray(network.forward(), dtype=np.float32)
    scores = (first + second[..., ::-1]) / 2
    shares = np.exp(scores - scores.max(axis=0))
    shares /= shares.sum(axis=0)
    whole = cv2.resize(shares.transpose(1, 2, 0), padded.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    seen = whole[: size[1], : size[0]]
    return np.asarray(cv2.resize(seen, (wide, tall), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


@cache
def _network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(MODEL))
