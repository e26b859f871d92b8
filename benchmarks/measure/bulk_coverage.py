"""How often the 95 % intervals of tilt, packing, pile, drum and hopper hold the truth, on records drawn by seed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid

from rigtwin.benchmarks.figures import Row, coverage
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.records import Profile, Series, Track
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drum import evaluate as drum
from rigtwin.measure.hopper import evaluate as hopper
from rigtwin.measure.packing import evaluate as packing
from rigtwin.measure.pile import evaluate as pile
from rigtwin.measure.tilt import evaluate as tilt
from rigtwin.measure.tilt.onset import FACTOR, Variant

Array = npt.NDArray[np.float64]
Cases = Callable[[int, int], list[Row]]

BEAD, CYLINDER, RADIUS = 0.006, 0.06, 0.075  # [m]
HEAPS = 8  # of one shape


def _holds(found: Quantity, truth: float) -> bool:
    low, high = found.interval95
    return low < truth < high


def _tilted(rng: np.random.Generator, variant: Variant) -> tuple[Series, Track, float, float]:
    """A record, and its true angle [deg] and time [s] of the onset."""
    degrees = float(rng.uniform(8, 35) if variant == "slide" else rng.uniform(1.5, 8))
    rate, noise, fps = float(rng.uniform(0.8, 5)), float(10 ** rng.uniform(-5, -4)), float(rng.choice([30, 60, 120]))
    onset = 1.5 + float(rng.uniform(0, 1 / fps))
    fine = np.arange(
        onset, 4.5, 2e-4
    )  # from the onset on: half a step late is more than the uncertainty of a good record
    angle = np.radians(degrees + rate * (fine - onset))
    friction = math.tan(math.radians(degrees)) * (float(rng.uniform(0.75, 0.95)) if variant == "slide" else 1.0)
    push = FACTOR[variant] * GRAVITY * (np.sin(angle) - friction * np.cos(angle))
    down = cumulative_trapezoid(cumulative_trapezoid(push, fine, initial=0), fine, initial=0)
    fine, down = fine[down < 0.08], down[down < 0.08]
    times = np.arange(0, fine[-1], 1 / fps)
    turn, way = np.radians(degrees + rate * (times - onset)), np.interp(times, fine, down)
    along = 0.12 - way + rng.normal(0, noise, len(times))
    place = np.column_stack([along * np.cos(turn), along * np.sin(turn)])
    seen = turn + np.radians(0.01) * rng.standard_normal(len(times))
    return (
        Series(times, seen, "plate_angle", "rad"),
        Track(times, place, np.full(len(times), noise)),
        degrees,
        onset,
    )


def tilts(count: int, seed: int) -> list[Row]:
    """Angle and time of the onset, sliding and rolling, 30 to 120 Hz."""
    rows = []
    variants: tuple[Variant, ...] = ("slide", "roll")
    for variant in variants:
        rng = np.random.default_rng(seed)
        hits: dict[str, list[bool]] = {"angle": [], "onset time": []}
        for _ in range(count):
            series, track, degrees, onset = _tilted(rng, variant)
            found = {
                q.quantity: q for q in tilt.evaluate(series, [track], variant=variant, bead_diameter=BEAD).quantities
            }
            hits["angle"].append(_holds(found[f"{tilt.FRICTION[variant]}_angle"], degrees))
            hits["onset time"].append(_holds(found["onset_time"], onset))
        rows += [coverage(f"tilt, {variant}, {name}", each) for name, each in hits.items()]
    return rows


def beds(count: int, seed: int) -> list[Row]:
    """Mean top of the surface beads from the outline of beads laid at random, none within another."""
    rng, hits = np.random.default_rng(seed), []
    x = np.linspace(-CYLINDER / 2, CYLINDER / 2, 601)
    reach = (CYLINDER - BEAD) / 2
    for _ in range(count):
        rough = float(rng.uniform(0.3, 0.42)) * BEAD
        places = np.empty((0, 3))
        for _ in range(600):
            across = reach * math.sqrt(rng.uniform()) * np.exp(2j * math.pi * rng.uniform())
            new = np.array([across.real, across.imag, 0.06 + rough * rng.standard_normal()])
            if len(places) < 105 and (len(places) == 0 or np.linalg.norm(places - new, axis=1).min() > 0.95 * BEAD):
                places = np.vstack([places, new])
        apart = np.hypot(*(places[:, None, :2] - places[None, :, :2]).T)
        higher = places[:, 2][:, None] > places[:, 2][None, :]
        truth = float(np.mean(places[~np.any((apart < 0.8 * BEAD) & higher, axis=0), 2])) + BEAD / 2
        inside = (BEAD / 2) ** 2 - (x - places[:, :1]) ** 2
        height = np.where(inside > 0, places[:, 2:] + np.sqrt(np.maximum(inside, 0)), -np.inf).max(axis=0)
        profile = Profile(x, np.where(np.isfinite(height), height, np.nan), np.full(len(x), 1e-5))
        found = next(
            q
            for q in packing.evaluate([profile], cylinder_diameter=CYLINDER, bead_diameter=BEAD).quantities
            if q.method == "surface bead tops"
        )
        hits.append(_holds(found, truth))
    return [coverage("packing, bed height", hits)]


def drums(count: int, seed: int) -> list[Row]:
    """Long-run angle from 120 frames of a straight surface that sways with a memory, and of single rough outlines."""
    rng, hits = np.random.default_rng(seed), []
    x = np.linspace(-RADIUS, RADIUS, 61)
    for _ in range(count):
        truth, memory, sway = (float(rng.uniform(*ends)) for ends in ((22, 45), (0.3, 0.95), (0.5, 2.5)))
        off = np.empty(120)
        off[0] = rng.standard_normal()
        for k in range(1, 120):
            off[k] = memory * off[k - 1] + math.sqrt(1 - memory**2) * rng.standard_normal()
        profiles = []
        for angle in truth + sway * off:
            height = -0.02 + math.tan(math.radians(angle)) * x + rng.normal(0, 4e-4, len(x))
            seen = np.where(np.hypot(x, height) < RADIUS, height, np.nan)
            profiles.append(Profile(x, seen, np.full(len(x), 4e-4)))
        found = drum.evaluate(profiles, np.arange(120) / 30, drum_diameter=2 * RADIUS).quantities
        hits.append(_holds(next(q for q in found if q.method == drum.MIDDLE), truth))
    return [coverage("drum, graphical, middle half", hits)]


def hoppers(count: int, seed: int) -> list[Row]:
    """Discharge time from counts between which the last particle leaves."""
    rng, hits = np.random.default_rng(seed), []
    for _ in range(count):
        step, opened = 1 / float(rng.choice([30, 60, 120, 240])), float(rng.uniform(0.2, 0.3))
        out = opened + np.sort(rng.uniform(0.02, float(rng.uniform(1, 3)), int(rng.integers(200, 800))))
        times = np.arange(0, out[-1] + 0.5, step)
        left = Series(times, len(out) - np.searchsorted(out, times).astype(np.float64), "particles left", "particles")
        found = {q.quantity: q for q in hopper.evaluate(left, opened=opened).quantities}
        hits.append(_holds(found["discharge_time"], float(out[-1]) - opened))
    return [coverage("hopper, discharge time", hits)]


def heaped(rng: np.random.Generator, slopes: tuple[float, float], foot: float) -> tuple[Profile, Array]:
    """Beads that fill a cone of two slopes [deg], its foot as many bead diameters from the axis.

    Their outline [m], and their centres [bead diameters].
    """
    tangents = [math.tan(math.radians(slope)) for slope in slopes]
    side = np.arange(-foot - 1, foot + 2)
    places = np.stack(np.meshgrid(side, side, np.arange(0, foot, 0.82), indexing="ij"), axis=-1).reshape(-1, 3)
    # layers of a loose random bed: no lattice survives
    places = places * (1.03, 1.03, 1.0) + rng.uniform(-0.45, 0.45, places.shape) * (1, 1, 0.7)
    surface = foot * sum(tangents) / 2 - np.hypot(places[:, 0], places[:, 1]) * np.where(places[:, 0] < 0, *tangents)
    places = places[(places[:, 2] < surface) & (places[:, 2] >= 0)] + (0, 0, 0.5)
    x = np.linspace(places[:, 0].min() - 0.49, places[:, 0].max() + 0.49, 900)
    height = np.zeros_like(x)
    for across, _, level in places[np.argsort(places[:, 2])]:
        near = slice(*np.searchsorted(x, (across - 0.5, across + 0.5)))
        cap = level + np.sqrt(np.maximum(0.25 - (x[near] - across) ** 2, 0))
        height[near] = np.maximum(height[near], cap)
    return Profile(x * BEAD, height * BEAD, np.full(len(x), 1e-5)), places


def piles(count: int, seed: int) -> list[Row]:
    """Angles of heaps of 15 to 40 beads' width that differ by where their beads lie; the truth is their mean."""
    rng = np.random.default_rng(seed)
    angles = {(pile.GRAPHICAL, pile.LINE): "graphical", (pile.GEOMETRIC, "apex"): "geometric"}
    hits: dict[str, list[bool]] = {name: [] for name in angles.values()}
    for _ in range(math.ceil(count / HEAPS)):
        left, right = (float(slope) for slope in rng.uniform(18, 35) + rng.uniform(-2, 2, 2))
        foot = float(rng.uniform(7.5, 20))
        heaps = [
            pile.evaluate([heaped(rng, (left, right), foot)[0]], base_diameter=2 * foot * BEAD, bead_diameter=BEAD)
            for _ in range(HEAPS)
        ]
        for key, name in angles.items():
            found = [
                q
                for heap in heaps
                for q in heap.quantities
                if (q.quantity, q.method) == key and q.detail["side"] == "mean"
            ]
            mean = sum(q.value for q in found) / HEAPS
            # a heap is off its own group's mean by less than off the true one
            factor = math.sqrt(HEAPS / (HEAPS - 1))
            hits[name] += [_holds(q, q.value + factor * (mean - q.value)) for q in found]
    return [coverage(f"pile, {name}, mean", each) for name, each in hits.items()]


CASES: tuple[Cases, ...] = (tilts, beds, piles, drums, hoppers)
