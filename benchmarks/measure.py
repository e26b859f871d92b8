"""The measuring against truth: bead centres beside other methods and the Cramer-Rao bound, intervals that hold, cost.

    python benchmarks/measure.py [--only CASE ...] [--count N]

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

import cv2
import numpy as np
import numpy.typing as npt
from bulk_coverage import CASES as BULK
from figures import Row, against, below, report
from measure_speed import speed
from motions import BEAD, STEEL, bounces, swing, through_a_camera

from rigtwin.lab.records import Track
from rigtwin.measure import drop, pendulum
from rigtwin.measure.bead import locate

Array = npt.NDArray[np.float64]
Centre = tuple[float, float] | None

FINE = 4  # pictures are drawn on a grid this much finer
CONTRAST, GROUND = 120.0, 60.0  # [grey levels]
DISCS = (  # radius [px], blur [px], signal to noise, shading across the bead's surroundings [grey levels]
    (5.0, 0.0, 20.0, 0.0),
    (12.0, 0.0, 5.0, 0.0),
    (12.0, 0.0, 20.0, 0.0),
    (12.0, 0.0, 20.0, 40.0),
    (12.0, 8.0, 20.0, 0.0),
    (25.0, 20.0, 20.0, 0.0),
)
SEED = int(os.environ.get("SEED", "1"))


# ------------------------------------------------------------------------------------------------------------- centres


def draw(centre: Array, radius: float, blur: float, size: int, shading: float) -> Array:
    """A disc smeared downwards by `blur` [px] before a shaded ground, through a lens of 0.7 px, without noise."""
    fine = (np.arange(size * FINE) + 0.5) / FINE - 0.5
    x, y = np.meshgrid(fine - centre[0], fine - centre[1])
    steps = max(1, round(2 * blur))
    cover = np.zeros_like(x)
    for k in range(steps):
        cover += np.clip((radius - np.hypot(x, y - ((k + 0.5) / steps - 0.5) * blur)) * FINE + 0.5, 0, 1)
    seen = cover.reshape(size, FINE, size, FINE).mean(axis=(1, 3)) / steps
    ground = GROUND + shading * (np.arange(size) / size - 0.5)[None]
    return np.asarray(cv2.GaussianBlur(ground + CONTRAST * seen, (0, 0), 0.7))


def bound(radius: float, blur: float, size: int, noise: float) -> Array:
    """Cramer-Rao bound of x and y [px]: noise over the root of the summed squares of the picture's derivative."""
    middle, step = np.array([size / 2 + 0.2, size / 2 + 0.3]), 0.25
    rows = []
    for move in np.eye(2) * step:
        change = draw(middle + move, radius, blur, size, 0) - draw(middle - move, radius, blur, size, 0)
        rows.append(noise / math.sqrt(float(np.sum((change / (2 * step)) ** 2))))
    return np.array(rows)


def by_hough(grey: npt.NDArray[np.uint8], radius: float) -> Centre:
    low, high = max(round(0.7 * radius), 2), round(1.4 * radius) + 1
    found = cv2.HoughCircles(grey, cv2.HOUGH_GRADIENT, 1, 20, param1=100, param2=10, minRadius=low, maxRadius=high)
    if found is None:
        return None
    x, y, _ = found.reshape(-1, 3)[0]
    return float(x), float(y)


def by_otsu(grey: npt.NDArray[np.uint8], _: float) -> Centre:
    _, mask = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    m = cv2.moments(max(outlines, key=cv2.contourArea))
    return (m["m10"] / m["m00"], m["m01"] / m["m00"]) if m["m00"] else None


def by_contour(grey: npt.NDArray[np.uint8], _: float) -> Centre:
    """Sub-pixel contour at half height and its area's centroid."""
    from skimage.measure import find_contours

    smooth = cv2.GaussianBlur(grey.astype(np.float64), (0, 0), 1.0)
    outlines = find_contours(smooth, (np.percentile(smooth, 2) + np.percentile(smooth, 99)) / 2)
    if not outlines:
        return None
    y, x = max(outlines, key=len).T
    cross = x[:-1] * y[1:] - x[1:] * y[:-1]
    area = cross.sum() / 2
    if abs(area) < 1:
        return None
    return float(((x[:-1] + x[1:]) * cross).sum() / (6 * area)), float(((y[:-1] + y[1:]) * cross).sum() / (6 * area))


def by_template(grey: npt.NDArray[np.uint8], radius: float) -> Centre:
    """Correlation with a sharp ideal disc, and a parabola through its peak."""
    side = 2 * math.ceil(radius + 4) + 1
    ideal = draw(np.array([side // 2, side // 2]), radius, 0, side, 0).astype(np.float32)
    score = cv2.matchTemplate(grey.astype(np.float32), ideal, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    if not (0 < row < score.shape[0] - 1 and 0 < column < score.shape[1] - 1):
        return None
    cut = score[row - 1 : row + 2, column - 1 : column + 2]
    x, y = (_peak(*line) for line in (cut[1], cut[:, 1]))
    return float(column + x + side // 2), float(row + y + side // 2)


def _peak(before: float, at: float, after: float) -> float:
    bend = before - 2 * at + after
    return float((before - after) / (2 * bend)) if bend else 0.0


OTHERS: dict[str, Callable[[npt.NDArray[np.uint8], float], Centre]] = {
    "sub-pixel contour": by_contour,
    "template": by_template,
    "Otsu and moments": by_otsu,
    "Hough": by_hough,
}


def centres(count: int) -> list[Row]:
    """Root mean square error of the centre, in multiples of the bound, and whether the stated sigma tells it."""
    rows = []
    for radius, blur, snr, shading in DISCS:
        rng = np.random.default_rng(SEED)
        size, noise = 2 * round(1.9 * radius + blur / 2 + 12), CONTRAST / snr
        best = bound(radius, blur, size, math.hypot(noise, 1 / math.sqrt(12)))
        errors: dict[str, list[Array]] = {name: [] for name in ("ours", *OTHERS)}
        told = []
        for _ in range(count):
            centre = size / 2 + rng.uniform(-1, 1, 2)
            ground = draw(np.array([-999.0, -999.0]), radius, 0, size, shading)
            picture = draw(centre, radius, blur, size, shading) + rng.normal(0, noise, (size, size))
            grey = np.clip(np.round(picture), 0, 255).astype(np.uint8)
            near = centre + rng.uniform(-1, 1, 2)
            found = locate(grey, ground, (float(near[0]), float(near[1])), radius)
            if found is not None:
                errors["ours"].append(np.array([found.x, found.y]) - centre)
                told.append(errors["ours"][-1] / found.sigma)
            for name, method in OTHERS.items():
                other = method(grey, radius)
                if other is not None and math.dist(other, centre) < radius:
                    errors[name].append(np.array(other) - centre)
        case = f"R {radius:g}, blur {blur:g}, SNR {snr:g}, shading {shading:g}"
        for name, each in errors.items():
            lost = f"{count - len(each)} of {count} lost"
            ratio = float(np.sqrt(np.mean((np.array(each) / best) ** 2))) if each else math.inf
            title = f"{case}: {name}, rms / bound"
            row = Row(title, ratio, note=lost)
            if name == "ours":
                row = below(title, ratio, 1.2 if blur else 1.15, note=f"bound {best[0]:.4f} / {best[1]:.4f} px; {lost}")
            rows.append(row)
        rows.append(
            against(f"{case}: rms of error / sigma", float(np.sqrt(np.mean(np.square(told)))), 1, relative=0.15)
        )
    return rows


# --------------------------------------------------------------------------------------------------------------- drops


def random_drop(rng: np.random.Generator) -> tuple[Track, dict[str, list[float]]]:
    """A track as filmed at 240 Hz, and the restitution of its bounces by each method."""
    e = float(rng.uniform(0.5, 0.85))
    times = np.arange(200) / 240
    noise = float(10 ** rng.uniform(-4.6, -3.8))
    drag = float(rng.normal(1.0, 0.1))  # a bead with a hole or a seam
    dwell = float(10 ** rng.uniform(-5, -3))
    height, release = float(rng.uniform(0.15, 0.4)), float(rng.uniform(0.02, 0.04))
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
    return [_coverage(f"drop, restitution by {method}", hits) for method, hits in inside.items()]


def _coverage(name: str, hits: Sequence[bool]) -> Row:
    share = float(np.mean(hits))
    return Row(
        f"{name}: 95 % intervals", share, "1", 0.95, "0.90 to 0.99", 0.90 <= share <= 0.99, f"{len(hits)} numbers"
    )


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
            check = next(each for each in drop.evaluate(record).checks if each.check == "gravity")
            verdict = check.message.partition("instead of")[2].partition(", or ")[0]
            named[name] += check.passed if name == "clean" else not check.passed and name in verdict
    clean = named.pop("clean") / count
    rows = [
        Row(f"gravity check names {name}", hits / count, wanted="at least 0.95", passed=hits >= 0.95 * count)
        for name, hits in named.items()
    ]
    return [*rows, below("gravity check, false alarms", 1 - clean, 0.0200001)]


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
    return [_coverage("pendulum, restitution by velocity", hits)]


def _seeded(case: Callable[[int, int], list[Row]]) -> Callable[[int], list[Row]]:
    seeded = functools.partial(case, seed=SEED)
    return functools.update_wrapper(seeded, case)


CASES: tuple[Callable[[int], list[Row]], ...] = (centres, drops, gravity, pendulums, *map(_seeded, BULK), speed)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [case.__name__ for case in CASES]
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    parser.add_argument("--count", type=int, default=100)
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
