"""The measuring against truth: bead centres beside other methods and the Cramer-Rao bound, intervals that hold, cost.

    python benchmarks/measure/accuracy.py [--only CASE ...] [--count N]

Everything is drawn or integrated here from `SEED`; `--count` is how many of each.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import math
import os
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import Row, below, coverage, report, small
from rigtwin.benchmarks.measure.bulk_coverage import CASES as BULK
from rigtwin.benchmarks.measure.centres import centres
from rigtwin.benchmarks.measure.motions import BEAD, STEEL, bounces, swing, through_a_camera
from rigtwin.benchmarks.measure.speed import speed
from rigtwin.lab.errors import BadInput
from rigtwin.lab.quantity import Check
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drop import evaluate as drop
from rigtwin.measure.pendulum import evaluate as pendulum

Array = npt.NDArray[np.float64]

SEED = int(os.environ.get("SEED", "1"))


# --------------------------------------------------------------------------------------------------------------- drops


def random_drop(rng: np.random.Generator) -> tuple[Track, dict[str, list[float]]]:
    """A track as filmed at 240 Hz, and the restitution of its bounces by each method."""
    e = float(rng.uniform(0.5, 0.85))
    times = np.arange(200) / 240
    noise = float(10 ** rng.uniform(-4.6, -3.8))
    drag = float(rng.normal(1.0, 0.1))  # a bead with a hole or a seam
    height, release = float(rng.uniform(0.15, 0.4)), float(rng.uniform(0.02, 0.04))
    # Hertz, Johnson 1985 section 11.4: a bead of steel on anything from rubber to steel
    modulus, mass, radius = float(10 ** rng.uniform(7, 11)), STEEL * math.pi / 6 * BEAD**3, BEAD / 2
    dwell = 2.87 * (mass**2 / (radius * modulus**2 * math.sqrt(2 * GRAVITY * height))) ** 0.2
    heights, apexes = bounces(times, height, e, release, drag=drag, dwell=dwell)
    seen = through_a_camera(np.stack([0.01 * times, heights], axis=1), rng)
    position = seen + rng.normal(0, noise, seen.shape)
    # heights are what they are, whatever the air took on the way
    by_height = [math.sqrt(after / before) for before, after in itertools.pairwise(apexes)]
    return Track(times, position, np.full(len(times), noise)), {"velocity": [e] * 9, "height": by_height}


def drops(count: int) -> list[Row]:
    """How often the 95 % intervals of the restitution hold the truth."""
    rng = np.random.default_rng(SEED)
    inside: dict[str, list[bool]] = {"height": [], "velocity": []}
    for _ in range(count):
        track, truth = random_drop(rng)
        for q in drop.evaluate(track, bead_diameter=BEAD, bead_density=STEEL).quantities:
            if q.quantity == "restitution_wall" and q.method in inside and q.detail["bounce"] in (1, 2):
                low, high = q.interval95
                inside[q.method].append(low < truth[q.method][int(q.detail["bounce"]) - 1] < high)
    return [coverage(f"drop, restitution by {method}", hits) for method, hits in inside.items()]


def gravity(count: int) -> list[Row]:
    """Whether the gravity check names what is wrong, and keeps quiet where nothing is."""
    rng = np.random.default_rng(SEED)
    named = {"the scale": 0, "slow motion": 0, "doubled frames": 0, "clean": 0}
    for _ in range(count):
        track, _ = random_drop(rng)
        wrong = 1 + 0.03 * float(rng.choice([-1, 1]))
        twice = np.arange(2 * len(track.time)) / 240
        faulty = {
            "the scale": Track(track.time, track.position * wrong, track.sigma),
            "slow motion": Track(track.time * float(rng.choice([2, 4, 8])), track.position, track.sigma),
            "doubled frames": Track(twice, np.repeat(track.position, 2, axis=0), np.repeat(track.sigma, 2)),
            "clean": track,
        }
        for name, record in faulty.items():
            check = _gravity_of(record)
            if check is None:
                continue  # refused in a sentence: neither named nor left in peace
            verdict = check.message.partition("instead of")[2].partition(", or ")[0]
            named[name] += check.passed if name == "clean" else not check.passed and name in verdict
    clean = named.pop("clean") / count
    rows = [
        Row(f"gravity check names {name}", hits / count, wanted="at least 0.95", passed=hits >= 0.95 * count)
        for name, hits in named.items()
    ]
    return [*rows, below("gravity check, false alarms", 1 - clean, 0.0200001)]


def _gravity_of(record: Track) -> Check | None:
    try:
        checks = drop.evaluate(record).checks
    except BadInput:
        return None
    return next(each for each in checks if each.check == "gravity")


# ----------------------------------------------------------------------------------------------------------- pendulums


def pendulums(count: int) -> list[Row]:
    """How often the 95 % interval of the restitution holds the truth."""
    rng, hits = np.random.default_rng(SEED), []
    times = np.arange(160) / 240
    for _ in range(count):
        e, length = float(rng.uniform(0.3, 0.95)), float(rng.uniform(0.15, 0.2))
        angles = swing(times, length, math.radians(float(rng.uniform(25, 55))), e, begun=0.05)
        noise = float(10 ** rng.uniform(-4.5, -3.7))
        places = length * np.stack([np.sin(angles), -np.cos(angles)], axis=-1) + np.array([[0, 0], [0.012, 0]])
        seen = through_a_camera(places.reshape(-1, 2), rng).reshape(places.shape)
        noisy = seen + rng.normal(0, noise, seen.shape)
        sigma = np.full(len(times), noise)
        tracks = [Track(times, noisy[:, bead], sigma, body) for bead, body in enumerate("AB")]
        for q in pendulum.evaluate(tracks).quantities:
            if q.quantity == "restitution_pair" and q.method == "velocity" and q.detail["collision"] == 1:
                low, high = q.interval95
                hits.append(low < e < high)
    return [coverage("pendulum, restitution by velocity", hits)]


def _seeded(case: Callable[[int, int], list[Row]]) -> Callable[[int], list[Row]]:
    seeded = functools.partial(case, seed=SEED)
    return functools.update_wrapper(seeded, case)


CASES: tuple[Callable[[int], list[Row]], ...] = (
    _seeded(centres),
    drops,
    gravity,
    pendulums,
    *map(_seeded, BULK),
    speed,
)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [case.__name__ for case in CASES]
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    parser.add_argument("--count", type=int, default=small(100, 3))
    options = parser.parse_args(arguments)
    rows: list[Row] = []
    for case in CASES:
        if case.__name__ in options.only:
            began = time.perf_counter()
            rows += case(options.count)
            sys.stderr.write(f"{case.__name__}: {time.perf_counter() - began:.1f} s\n")
    return report("bench-measure", rows, seed=SEED, count=options.count)


if __name__ == "__main__":
    sys.exit(main())
