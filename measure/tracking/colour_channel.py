"""Choose the linear combination of colours with the highest contrast of a bead to its background."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage
from rigtwin.measure.media.video import Frame
from rigtwin.measure.tracking.link import SpotPath, place_on

VISIBLE = 6.0  # contrast-to-noise ratio above which luma is sufficient
RING = 1.3, 2.5  # inner and outer radius of the surroundings of a bead over its radius
BETTER = 1.3  # minimum gain of contrast-to-noise ratio against shadows; luma has the full resolution
LEAST_NOISE = (
    0.3  # [grey levels squared], minimum variance of each of three colours (rounding); a third for one channel
)


@dataclass(frozen=True)
class Channel:
    """Conversion of a colour picture to grey: luma, or a linear combination of the colours."""

    weights: tuple[float, float, float] | None = None  # of blue, green, red; None: luma
    offset: float = 0.0  # [grey levels]

    def grey(self, frame: Frame) -> GreyImage:
        """The grey picture, 8 bit, shape (height, width)."""
        if self.weights is None:
            return frame.grey
        mix = cv2.transform(frame.colour, np.array([[*self.weights, self.offset]], dtype=np.float32))
        return np.asarray(mix, dtype=np.uint8)


LUMA = Channel()


def best_channel(frames: Sequence[Frame], path: SpotPath) -> Channel:
    """The combination of colours that separates the bead best from the background (Fisher's discriminant).

    A wooden bead in front of a grey wall has a lit and a dark side, but one hue. Luma is kept unless another
    combination is clearly better, because luma has the full resolution. A dozen frames spread over the path are enough.
    """
    where = place_on(path)
    places = [where(frame.index)[0] for frame in frames]
    differences, noises, scenery = [], [], []
    for k, (frame, place) in enumerate(zip(frames, places, strict=True)):
        other = int(np.argmax([math.dist(place, elsewhere) for elsewhere in places]))
        if math.dist(place, places[other]) < 4 * path.radius:
            continue
        rows, columns = _disc_pixels(place, 0.7 * path.radius, frame.grey.shape)
        behind = frames[other].colour[rows, columns].astype(np.float64)
        differences.append(frame.colour[rows, columns] - behind)
        scenery.append(behind)
        third = frames[k - 1].colour[::7, ::7].astype(np.float64) - frame.colour[::7, ::7]
        noises.append(third.reshape(-1, 3))
    if not differences:
        return LUMA
    return _fisher(np.concatenate(differences), _noise(np.concatenate(noises)), np.concatenate(scenery))


def channel_without_shadows(frames: Sequence[Frame], path: SpotPath) -> Channel:
    """The combination of colours that separates the bead best from all that changes around it, as shadows do.

    As `best_channel`, with the changes in a ring around the bead as the noise.
    """
    where = place_on(path)
    places = [where(frame.index)[0] for frame in frames]
    beads, rings, scenery = [], [], []
    for frame, place in zip(frames, places, strict=True):
        other = int(np.argmax([math.dist(place, elsewhere) for elsewhere in places]))
        if math.dist(place, places[other]) < 4 * path.radius:
            continue
        behind = frames[other].colour.astype(np.float64)
        disc = _disc_pixels(place, 0.7 * path.radius, frame.grey.shape)
        beads.append(frame.colour[disc] - behind[disc])
        scenery.append(behind[disc])
        ring = np.zeros(frame.grey.shape, dtype=np.uint8)
        cv2.circle(ring, (round(place[0]), round(place[1])), round(RING[1] * path.radius), 1, cv2.FILLED)
        cv2.circle(ring, (round(place[0]), round(place[1])), round(RING[0] * path.radius), 0, cv2.FILLED)
        rings.append(frame.colour[ring > 0] - behind[ring > 0])
    if not beads:
        return LUMA
    around = np.concatenate(rings)
    noise = around.T @ around / len(around) + LEAST_NOISE * np.eye(3)
    return _fisher(np.concatenate(beads), noise, np.concatenate(scenery), clear=math.inf, better=BETTER)


def luma_is_clear(greys: Mapping[int, GreyImage], path: SpotPath) -> bool:
    """Whether the contrast in luma is sufficient, so that colours need not be read."""
    where = place_on(path)
    places = {index: where(index)[0] for index in greys}
    differences, noises = [], []
    for index, before in zip(list(greys)[1:], greys, strict=False):
        other = max(places, key=lambda k: math.dist(places[index], places[k]))
        noises.append(greys[before][::7, ::7].astype(np.float64) - greys[index][::7, ::7])
        if math.dist(places[index], places[other]) >= 4 * path.radius:
            disc = _disc_pixels(places[index], 0.7 * path.radius, greys[index].shape)
            differences.append(greys[index][disc].astype(np.float64) - greys[other][disc])
    if not differences:
        return False
    noise = _noise(np.concatenate([each.reshape(-1, 1) for each in noises]))
    return _visibility(np.concatenate(differences)[:, None], np.ones(1), noise) > VISIBLE


def _noise(changes: Array) -> Array:
    """Noise covariance of one frame, shape (colours, colours), from frame differences, shape (n, colours).

    Large differences (motion) are excluded.
    """
    calm = changes[np.all(np.abs(changes) <= 3 * np.percentile(np.abs(changes), 68, axis=0) + 1, axis=1)]
    colours = changes.shape[1]
    return np.asarray(np.atleast_2d(np.cov(calm.T)) / 2 + LEAST_NOISE * colours / 3 * np.eye(colours))


def _visibility(differences: Array, weights: Array, noise: Array) -> float:
    """Contrast-to-noise ratio, root mean square over the bead, shading included."""
    return math.sqrt(float(np.mean((differences @ weights) ** 2)) / float(weights @ noise @ weights))


def _disc_pixels(
    centre: tuple[float, float], radius: float, shape: tuple[int, ...]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    height, width = shape[:2]
    disc = np.zeros((height, width), dtype=np.uint8)
    cv2.circle(disc, (round(centre[0]), round(centre[1])), max(round(radius), 1), 1, cv2.FILLED)
    rows, columns = np.nonzero(disc)
    return rows, columns


def _fisher(
    differences: Array, noise: Array, scenery: Array, *, clear: float = VISIBLE, better: float = 2.0
) -> Channel:
    """Fisher's discriminant of differences, shape (n, 3), against noise of this covariance, shape (3, 3).

    Luma if its contrast-to-noise ratio is above `clear`, or that of the discriminant is not `better` times as high.
    """
    if len(differences) < 2 or not (mean := differences.mean(axis=0)).any():
        return LUMA  # no direction in which the colours differ
    mix = np.linalg.solve(np.cov(differences.T) + 2 * noise, mean)
    luma = np.array([0.114, 0.587, 0.299])

    # colour is stored with half the resolution and coarser quantisation: it must be clearly better than luma
    seen = _visibility(differences, luma, noise)
    if seen > clear or _visibility(differences, mix, noise) < better * seen:
        return LUMA
    # gain limited by the 8-bit range: contrast of 90 levels or noise of 2 levels, whichever is reached first
    gain = min(90 / abs(float(mix @ mean)), 2 / math.sqrt(float(mix @ noise @ mix)))
    weights = mix * gain
    middle = 128.0 - float(weights @ (np.median(scenery, axis=0) + mean / 2))
    return Channel((float(weights[0]), float(weights[1]), float(weights[2])), middle)
