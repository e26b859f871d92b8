"""How far what lies behind a bead shifts its centre from place to place, as a share of the noise of a point.

    python benchmarks/measure/background_bias.py [--only HARDNESS ...] [--count N]

Pendulums are drawn from `SEED` as in hard_footage.py.  The error of every bead in every frame, against the truth, is
taken for a sum of the ways in which `rigtwin.measure.pendulum.swing_fit` lets the ground shift it, each with the same
standard deviation, and of noise that neighbouring frames share in part; its likelihood is printed.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import Row, report
from rigtwin.benchmarks.measure.draw_footage import film
from rigtwin.benchmarks.measure.hard_footage import CASES, fewer_frames, swung
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.progress import silent
from rigtwin.measure.media.video import open_video
from rigtwin.measure.pendulum import observe as pendulum
from rigtwin.measure.pendulum.swing_fit import fit_swings, ground_ways

Array = npt.NDArray[np.float64]

SEED = int(os.environ.get("SEED", "1"))
USUAL = ("clean", "2.5 degrees of roll", "variable frame rate", "highlight", "glare", "noise", "low contrast", "blur")
SHARES = np.array([0.05, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0])
SHARED = 0.2  # correlation of the noise of neighbouring frames
OUTLIER = 6.0  # outlier limit, in robust standard deviations of the error


def likelihoods(name: str, seed: int, folder: Path) -> Array:
    """Logarithms, of every share in `SHARES`, in one film; constant parts left out."""
    case, rng = CASES[name], np.random.default_rng([seed, *name.encode()])
    case = replace(case, footage=fewer_frames(case.footage, 60.0))
    stage, _ = swung(case, rng)
    video = open_video(film(folder / "film.mp4", stage, case.footage, rng), Camera(frame_rate=case.footage.rate))
    seen = pendulum.observe_film(video, Camera(frame_rate=case.footage.rate), None, silent)
    fit = fit_swings(pendulum.picture_tracks(seen.beads, seen.times))
    total = np.zeros(len(SHARES))
    for bead, (track, used, ways) in enumerate(zip(fit.tracks, fit.used, ground_ways(fit), strict=True)):
        moments = track.time[used] + 0.5 * case.footage.exposure / case.footage.rate
        true, _ = stage.view.project(stage.places(moments))
        weight = np.median(track.sigma) / track.sigma[used]
        error = track.position[used] * [1, -1] - true[:, bead]
        total += np.sum(
            [_likelihoods(each, ways, weight, track.time[used] * video.frame_rate) for each in error.T], axis=0
        )
    return total


def _likelihoods(error: Array, ways: Array, weight: Array, frame: Array) -> Array:
    """Of one coordinate [px] of one bead; the noise and a shift of all frames alike are left to the data."""
    off = error - np.median(error)
    sound = np.abs(off) < OUTLIER * 1.4826 * np.median(np.abs(off)) + 1e-6
    weight, frame = weight[sound], frame[sound]
    off, ways = off[sound] * weight, ways[sound] * weight[:, None]
    white = np.linalg.inv(np.linalg.cholesky(SHARED ** np.abs(np.rint(frame[:, None] - frame))))
    off, ways, alike = white @ off, white @ ways, white @ weight
    found = []
    for share in SHARES:
        inner = np.eye(ways.shape[1]) / share**2 + ways.T @ ways
        left = np.eye(len(off)) - ways @ np.linalg.solve(inner, ways.T)
        level = alike @ left @ alike
        power = off @ left @ off - (alike @ left @ off) ** 2 / level
        spread = np.linalg.slogdet(inner)[1] + 2 * ways.shape[1] * math.log(share) + math.log(level)
        found.append(-0.5 * (spread + (len(off) - 1) * math.log(power / (len(off) - 1))))
    return np.array(found)


def ground(count: int, names: Sequence[str]) -> list[Row]:
    """By hardness and for all: the likeliest share, and how much less likely the others are."""
    rows, total = [], np.zeros(len(SHARES))
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            mine = np.zeros(len(SHARES))
            for seed in range(SEED, SEED + count):
                try:
                    mine += likelihoods(name, seed, Path(folder))
                except BadInput as error:
                    sys.stderr.write(f"{name}: refused: {error}\n")
            rows.append(_row(name, mine))
            total += mine
    return [*rows, _row("all", total)]


def _row(name: str, likelihood: Array) -> Row:
    less = ", ".join(
        f"{share:g}: {fall:.1f}" for share, fall in zip(SHARES, likelihood - likelihood.max(), strict=True)
    )
    return Row(f"pendulum, {name}: share of the noise", float(SHARES[np.argmax(likelihood)]), note=f"log odds {less}")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=tuple(CASES), default=USUAL)
    parser.add_argument("--count", type=int, default=1)
    options = parser.parse_args(arguments)
    return report("bench-ground", ground(options.count, options.only), seed=SEED, count=options.count)


if __name__ == "__main__":
    sys.exit(main())
