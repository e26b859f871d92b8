"""A heap of equal beads built by geometry alone, and the outline and angles that a side view of it has.

A ring of beads is glued along the edge of a round plate.  Inside, beads are set one by one at places where they rest
on three others (or on the plate), drawn at random among the low ones, as long as they stay under an uneven cone.
No forces, no friction: the slope is put in, the surface is as rough as beads are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class HeapSetting:
    """What the heap is to be."""

    diameter: float  # [m], of a bead
    base_diameter: float  # [m], of the round plate
    slope: float  # [rad], mean slope of the envelope
    unevenness: float  # [rad], how much the slope changes around the heap
    tip_radius: float  # [m], over which the tip is rounded
    seed: int


def build_heap(setting: HeapSetting) -> Floats:
    """Bead centres [m], shape (n, 3), z above the plate; the glued ring comes first."""
    rng = np.random.default_rng(setting.seed)
    d, radius = setting.diameter, setting.diameter / 2
    beads = _ring(setting, rng)
    beads = _floor(beads, setting, rng)
    phase = rng.uniform(0, 2 * np.pi, 4)
    weight = rng.normal(size=4) / 2
    sites = _resting_places(beads, np.arange(len(beads)), d)
    while True:
        under = sites[:, 2] + radius < _envelope(sites, setting, phase, weight)
        free = sites[under & _clear(sites, beads, d)]
        if not len(free):
            return beads
        # rain falls anywhere, beads end up low: choose among the lowest fifth
        low = np.argsort(free[:, 2])[: max(1, len(free) // 5)]
        chosen = free[rng.choice(low)]
        beads = np.vstack([beads, chosen])
        sites = np.vstack([free, _resting_places(beads, np.array([len(beads) - 1]), d)])


def _ring(setting: HeapSetting, rng: np.random.Generator) -> Floats:
    d = setting.diameter
    reach = (setting.base_diameter - d) / 2
    count = int(np.pi / np.arcsin(d / (2 * reach) * 1.012))
    gaps = 1 + 0.3 * rng.random(count)
    spare = 2 * np.pi - count * 2 * np.arcsin(d / (2 * reach))
    angle = np.cumsum(2 * np.arcsin(d / (2 * reach)) + spare * gaps / gaps.sum())
    return np.column_stack([reach * np.cos(angle), reach * np.sin(angle), np.full(count, d / 2)])


def _floor(beads: Floats, setting: HeapSetting, rng: np.random.Generator) -> Floats:
    """Loose beads on the plate inside the ring, thrown at random until no more fit in many tries."""
    d = setting.diameter
    reach = setting.base_diameter / 2 - d
    misses = 0
    while misses < 3000:
        place = rng.uniform(-reach, reach, 2)
        point = np.array([*place, d / 2])
        if np.hypot(*place) < reach and np.min(np.linalg.norm(beads - point, axis=1)) >= d:
            beads, misses = np.vstack([beads, point]), 0
        else:
            misses += 1
    return beads


def _envelope(sites: Floats, setting: HeapSetting, phase: Floats, weight: Floats) -> Floats:
    """Height under which bead tops must stay [m]: a cone with a round tip whose slope changes round the heap."""
    angle = np.arctan2(sites[:, 1], sites[:, 0])
    wave = sum(weight[k] * np.cos((k + 1) * angle + phase[k]) for k in range(4))
    slope = np.tan(setting.slope + setting.unevenness * wave)
    distance = np.hypot(sites[:, 0], sites[:, 1])
    rounded = np.hypot(distance, setting.tip_radius) - setting.tip_radius
    edge = np.hypot(setting.base_diameter / 2, setting.tip_radius) - setting.tip_radius
    return setting.diameter * 0.75 + slope * (edge - rounded)


def _resting_places(beads: Floats, new: npt.NDArray[np.int_], d: float) -> Floats:
    """Centres of a bead that touches three beads from above, at least one of them `new`, and lies stably."""
    found = []
    for i in new:
        near = np.flatnonzero((np.linalg.norm(beads - beads[i], axis=1) < 2 * d) & (np.arange(len(beads)) != i))
        if len(near) < 2:
            continue
        j, k = (near[index] for index in np.triu_indices(len(near), 1))
        places = _on_three(beads[i], beads[j], beads[k], d)
        found.append(places)
    places = np.vstack(found) if found else np.empty((0, 3))
    return places[_clear(places, beads, d)]


def _on_three(a: Floats, b: Floats, c: Floats, d: float) -> Floats:
    """The upper of the two points at distance d from a, b and c; only where it stands over their triangle."""
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    square = np.einsum("ij,ij->i", normal, normal)
    good = square > 1e-6 * d**4
    ab, ac, normal, square = ab[good], ac[good], normal[good], square[good]
    ab2, ac2 = np.einsum("ij,ij->i", ab, ab), np.einsum("ij,ij->i", ac, ac)
    to_centre = (np.cross(normal, ab) * ac2[:, None] + np.cross(ac, normal) * ab2[:, None]) / (2 * square[:, None])
    rise2 = d * d - np.einsum("ij,ij->i", to_centre, to_centre)
    up = normal * np.sign(normal[:, 2:]) / np.sqrt(square)[:, None]
    high = rise2 > 0
    offset = to_centre[high] + up[high] * np.sqrt(rise2[high])[:, None]
    inside = _over_triangle(offset, ab[high], ac[high])
    return a + offset[inside]


def _over_triangle(point: Floats, ab: Floats, ac: Floats) -> npt.NDArray[np.bool_]:
    """Seen from above, is the point inside the triangle 0, ab, ac (with a small margin)?"""
    det = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    det = np.where(np.abs(det) < 1e-15, np.nan, det)
    s = (point[:, 0] * ac[:, 1] - point[:, 1] * ac[:, 0]) / det
    t = (ab[:, 0] * point[:, 1] - ab[:, 1] * point[:, 0]) / det
    return (s > 0.02) & (t > 0.02) & (s + t < 0.98)


def _clear(places: Floats, beads: Floats, d: float) -> npt.NDArray[np.bool_]:
    if not len(places):
        return np.zeros(0, dtype=bool)
    apart = np.linalg.norm(places[:, None] - beads[None], axis=2)
    return apart.min(axis=1) > d * (1 - 1e-6)


@dataclass(frozen=True)
class Outline:
    """The heap's edge seen from the side by parallel rays: height of the highest bead surface over each x."""

    x: Floats  # [m], from the axis of the plate, to the right in the view
    height: Floats  # [m], above the plate; 0 where there is no bead


def outline(beads: Floats, diameter: float, turn: float, step: float = 0.00025) -> Outline:
    """Outline after the plate was turned by `turn` [rad] (counter-clockwise seen from above), seen along +y."""
    across = beads[:, 0] * np.cos(turn) - beads[:, 1] * np.sin(turn)
    edge = np.ceil((np.abs(across).max() + diameter / 2) / step) * step
    x = np.arange(-edge, edge + step / 2, step)
    under = (diameter / 2) ** 2 - (x[:, None] - across[None]) ** 2
    top = np.where(under > 0, beads[None, :, 2] + np.sqrt(np.maximum(under, 0)), 0.0)
    return Outline(x, top.max(axis=1))


def flank_angle(edge: Outline, side: str, low: float, high: float) -> float:
    """Angle [deg] of the straight line with least orthogonal distances through one flank.

    The flank runs from the outermost point at `high` times the heap's height to the outermost point at `low` times.
    """
    sign = -1.0 if side == "left" else 1.0
    outward = edge.x * sign
    top = edge.height.max()
    upper = outward[edge.height >= high * top].max()
    lower = outward[edge.height >= low * top].max()
    part = (outward >= upper) & (outward <= lower)
    points = np.column_stack([outward[part], edge.height[part]])
    direction = np.linalg.svd(points - points.mean(axis=0))[2][0]
    return float(np.degrees(np.arctan(-direction[1] / direction[0])))


def apex_angle(edge: Outline, base: float) -> float:
    """atan(2 H / B) [deg] of the outline's height over a base width [m]."""
    return float(np.degrees(np.arctan(2 * edge.height.max() / base)))
