"""Motion along the line of sight: the bead comes nearer to the camera or goes away, which changes its size.

A pinhole camera shows a bead at distance z in the size and at the places f / z.  The radius of its image therefore
gives the distance over time, and the plate, seen lower the nearer the bead hits it, the row of the horizon.  With both
the track is brought to the plane of the first contact, where one scale holds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Check, Quantity, root_sum_of_squares
from rigtwin.lab.records import Track
from rigtwin.measure.drop.bounce_fit import Bounces
from rigtwin.measure.robust import mad_std
from rigtwin.measure.tracking.follow import Chase, Growth

HORIZON = 0.25  # prior standard deviation of the row of the horizon about the middle, over the picture's height
FARTHEST = 0.75  # largest distance of the horizon from the middle over the picture's height, three deviations
LEVEL = 0.5  # [px], standard uncertainty of the plate's level at a contact
FINEST = 1e-3  # lower limit of the relative scatter of the radii
DENIED = 3.0  # standard uncertainties between the growth of the image and of the acceleration that exclude each other
SLOWLY = 0.02  # prior standard deviation of the relative change of 1 / size from flight to flight, per flight


@dataclass(frozen=True)
class Depth:
    """Distance of the bead from the camera over that at the first contact."""

    times: Array  # [s], shape (n,): begin of the record, contacts, end
    distances: Array  # shape (n,)
    radius: float  # [px], of the bead's image at the first contact
    centre: tuple[float, float]  # [px], x and y (up) of the point towards which everything shrinks
    unsure: float  # relative standard uncertainty of `distances` - 1
    horizon_sigma: float  # [px], standard uncertainty of the row of the horizon, `centre[1]`

    def at(self, time: Array) -> Array:
        """Distance at times [s], constant outside the record."""
        return np.interp(time, self.times, self.distances)

    def varied(self) -> tuple[Depth, Depth]:
        """The depth with each of its two uncertainties added."""
        further = replace(self, distances=1 + (1 + self.unsure) * (self.distances - 1))
        return further, replace(self, centre=(self.centre[0], self.centre[1] + self.horizon_sigma))

    @property
    def check(self) -> Check:
        """What was corrected."""
        change = 100 * float(self.distances[-1] / self.distances[0] - 1)
        where = "goes away from the camera" if change > 0 else "comes nearer to the camera"
        message = f"by the size of its image the bead {where} by {abs(change):.1f} % of its distance: corrected."
        return Check("line_of_sight", True, change, 0.0, message)


def find_depth(seen: Chase, pixels: Track, fitted: Bounces) -> Depth | None:
    """The distance over time; None if the size of the bead's image is constant, or plate or flights contradict it.

    `fitted` are the bounces of the track `pixels` as it is seen [px, y up].
    """
    if not seen.growth.known:
        return None
    radii = np.array([sighting.image.radius for sighting in seen.sightings])
    contacts = fitted.contact_times
    knots = np.array([pixels.time[0], *contacts, max(float(pixels.time[-1]), float(contacts[-1]) + 1e-6)])
    hats = np.stack([np.interp(pixels.time, knots, each) for each in np.eye(len(knots))], axis=1)
    usual = float(np.median(radii))
    # neighbouring flights have similar speeds along the line of sight, unless the bead spins
    bends = np.diff(np.eye(len(knots)), n=2, axis=0) / SLOWLY
    inverse = usual / radii
    weight, scatter = np.ones(len(radii)), FINEST
    for _ in range(5):
        design = np.concatenate([hats * (weight / scatter)[:, None], bends])
        values = np.concatenate([inverse * weight / scatter, np.zeros(len(bends))])
        nodes = np.linalg.lstsq(design, values, rcond=None)[0]
        off = inverse - hats @ nodes
        scatter = max(mad_std(off, centre=0.0), FINEST)
        weight = 1 / (1 + (off / (3 * scatter)) ** 2)
    first = float(nodes[1])
    height, width = seen.scene.picture.shape
    middle = (width - 1) / 2, -(height - 1) / 2
    unsure = seen.growth.rate_sigma / abs(seen.growth.rate)
    depth = Depth(knots, nodes / first, usual / first, middle, unsure, HORIZON * height)
    if _denied(depth, fitted):
        return None
    row, sigma = _horizon(depth, fitted, height)
    if abs(row - middle[1]) > FARTHEST * height:
        return None
    return replace(depth, centre=(middle[0], row), horizon_sigma=sigma)


def _denied(depth: Depth, fitted: Bounces) -> bool:
    """Whether the flights deny the change of distance: a nearer bead also seems to fall with a larger acceleration.

    A change of the image's size alone may come from its blur.
    """
    grown, sigma = fitted.growth
    sizes = 1 / depth.at(np.append(fitted.contact_times[1:], depth.times[-1])) - 1
    return bool(np.any(np.abs(sizes - grown) > DENIED * np.hypot(sigma, depth.unsure * sizes)))


def _horizon(depth: Depth, fitted: Bounces, height: int) -> tuple[float, float]:
    """Row of the horizon [px, y up] and its uncertainty, from the plate's level at the contacts.

    A priori it is near the middle of the picture.
    """
    levels, sizes = fitted.level(fitted.contact_times), 1 / depth.at(fitted.contact_times)
    design = np.column_stack([1 - sizes, sizes]) / LEVEL
    prior = np.array([[1 / (HORIZON * height), 0.0]])
    values = np.concatenate([levels / LEVEL, [depth.centre[1] / (HORIZON * height)]])
    design = np.concatenate([design, prior])
    horizon, _ = np.linalg.lstsq(design, values, rcond=None)[0]
    return float(horizon), math.sqrt(float(np.linalg.inv(design.T @ design)[0, 0]))


def in_plane(pixels: Track, depth: Depth) -> Track:
    """The track as it would be seen if the bead stayed at the distance of its first contact [px, y up]."""
    distance, centre = depth.at(pixels.time)[:, None], np.array(depth.centre)
    return replace(pixels, position=centre + distance * (pixels.position - centre), sigma=distance[:, 0] * pixels.sigma)


def at_first_contact(seen: Chase, depth: Depth, frame: float) -> Chase:
    """The chase with the radius of the bead's image at the first contact, in frame number `frame`."""
    ahead = 1 + seen.growth.rate * (frame - seen.growth.middle)
    growth = Growth(seen.growth.rate / ahead, seen.growth.rate_sigma / ahead, frame)
    return replace(seen, radius=depth.radius, growth=growth)


def with_depth(quantity: Quantity, others: Sequence[Sequence[Quantity]]) -> Quantity:
    """The quantity with the part of the depth in its budget: changes by each uncertainty of the depth, in `others`."""

    def key(one: Quantity) -> tuple[object, ...]:
        return one.quantity, one.method, one.detail.get("bounce")

    values = [other.value for found in others for other in found if key(other) == key(quantity)]
    budget = {**quantity.budget, "line of sight": math.hypot(*(value - quantity.value for value in values))}
    return replace(quantity, budget=budget, std_uncertainty=root_sum_of_squares(budget))
