"""Clips of known truth with one difficulty each: what is measured of them, and whether a wrong number is flagged.

    python benchmarks/measure/hard_footage.py [--rig drop|pendulum|slide|roll] [--only HARDNESS ...] [--count N]

Every clip is drawn from `SEED`.  A number may lie off by more than two standard uncertainties only where it is doubtful
or where the clip is refused in a sentence; "silent" is what must not be.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import SMOKE, Row, coverage, report, small
from rigtwin.benchmarks.measure.draw_footage import Footage, Picture, Stage, View, box, film
from rigtwin.benchmarks.measure.motions import BEAD, STEEL, bounces, run_down, swing
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.measure.drop import measurement as drop
from rigtwin.measure.pendulum import measurement as pendulum
from rigtwin.measure.tilt import evaluate as tilt_evaluate
from rigtwin.measure.tilt import measurement as tilt
from rigtwin.measure.tilt.onset import FACTOR, Variant

Array = npt.NDArray[np.float64]
Truth = dict[tuple[str, str, object], float]  # by quantity, method, and bounce or body

SEED = int(os.environ.get("SEED", "1"))
OFF = 2.0  # standard uncertainties: a larger error is flagged, or silent
WIDE = 1.96  # standard uncertainties, half of a 95 % interval
FAR = 3.0  # of these none may be silent; two are passed by chance in one of twenty numbers

CLEAN = Footage()


@dataclass(frozen=True)
class Case:
    """One hardness: how it is filmed, how the camera stands, and what the experimenter says."""

    footage: Footage = CLEAN
    view: Callable[[View], View] = lambda view: view
    camera: Callable[[Camera], Camera] = lambda camera: camera
    depth: float = 0.0  # [m/s], how fast the bead comes towards the camera after its bounce
    bead: float | None = None  # [m], the bead's diameter where it is not the usual one


def all_but_a_tenth(count: int, rng: np.random.Generator) -> list[int]:
    """Frames of a film that are kept where a tenth of them got lost; times count from the first."""
    return sorted({0, *rng.choice(count, int(0.9 * count), replace=False).tolist()})


def _all_but_one(count: int, rng: np.random.Generator) -> list[int]:
    gone = int(rng.integers(count // 3, count // 2))
    return [k for k in range(count) if k != gone]


def _each_sixth_again(count: int, _: np.random.Generator) -> list[int]:
    return [k - 1 if k % 6 == 5 else k for k in range(count)]


def _rolled(view: View) -> View:
    return replace(view, roll=math.radians(2.5))


def _near_and_askew(view: View) -> View:
    """From 0.35 m, aimed 3 degrees too low and 2 degrees sideways."""
    return replace(view, away=0.35, pitch=math.radians(3), yaw=math.radians(2))


def _barrelled(view: View) -> View:
    return replace(view, bend=-0.1)


def _from_afar(view: View) -> View:
    """The same picture, of which the beads fill less."""
    return replace(view, scale=3 * view.scale, origin=(view.origin[0], view.height / 2 + 40))


def _no_rate(camera: Camera) -> Camera:
    return replace(camera, frame_rate=None)


CASES: dict[str, Case] = {
    "clean": Case(),
    "occluder": Case(replace(CLEAN, bar=True)),
    "variable frame rate": Case(replace(CLEAN, kept=all_but_a_tenth, stamped=True)),
    "variable rate, not stated": Case(replace(CLEAN, kept=all_but_a_tenth, stamped=True), camera=_no_rate),
    "dropped frames": Case(replace(CLEAN, kept=all_but_a_tenth)),
    "one frame dropped": Case(replace(CLEAN, kept=_all_but_one)),
    "duplicated frames": Case(replace(CLEAN, kept=_each_sixth_again)),
    "2.5 degrees of roll": Case(view=_rolled),
    "dark on dark": Case(replace(CLEAN, ground=26.0, bead=14.0, mottle=1.0, noise=1.5)),
    "low contrast": Case(replace(CLEAN, bead=132.0, shading=0.15, mottle=2.0)),
    "glare": Case(replace(CLEAN, glare=260.0)),
    "shake": Case(replace(CLEAN, shake=1.5)),
    "1000 fps stored at 30, stated": Case(replace(CLEAN, rate=1000.0, stored_rate=30.0)),
    "1000 fps stored at 30, not stated": Case(replace(CLEAN, rate=1000.0, stored_rate=30.0), camera=_no_rate),
    "blur": Case(replace(CLEAN, rate=120.0, exposure=0.95)),
    "noise": Case(replace(CLEAN, noise=15.0)),
    "compression": Case(replace(CLEAN, crf=38)),
    "interlaced": Case(replace(CLEAN, rate=60.0, interlaced=True)),
    "small bead": Case(view=_from_afar),
    "spin": Case(replace(CLEAN, bead=95.0, marked=True)),
    "highlight": Case(replace(CLEAN, shine=190.0, ground=95.0)),
    "shadow": Case(replace(CLEAN, shadow=0.5)),
    "perspective": Case(view=_near_and_askew),
    "barrel lens": Case(view=_barrelled),
    "hand": Case(replace(CLEAN, hand=True)),
    "all at once": Case(
        replace(CLEAN, noise=6.0, crf=28, shadow=0.3, shake=0.7, shine=120.0, exposure=0.6), view=_rolled
    ),
}
OF_DROPS = {"towards the camera": Case(depth=0.25)}


def fewer_frames(footage: Footage, rate: float) -> Footage:
    """At most `rate` [1/s] of them, where the benchmark only shows that it runs."""
    return replace(footage, rate=min(footage.rate, small(math.inf, rate)))


def seen_by(case: Case, view: View) -> View:
    """How the camera of a case sees what `view` shows, in a quarter of the pixels where it only shows that it runs."""
    if not SMOKE:
        return case.view(view)
    high = 4 * round(view.height / 8)  # interlaced H.264 asks for a multiple of four
    half = View(view.width // 2, high, 2 * view.scale, (view.origin[0] / 2, view.origin[1] / 2))
    return case.view(half)


def cases_of(rig: str) -> dict[str, Case]:
    if rig in ("slide", "roll"):  # what rests on a plate does not spin
        return {name: case for name, case in CASES.items() if name != "spin"}
    return CASES | (OF_DROPS if rig == "drop" else {})


# ----------------------------------------------------------------------------------------------------------------- rigs


def dropped(case: Case, rng: np.random.Generator) -> tuple[Stage, Truth]:
    """A steel bead of 6 mm that bounces on a plate."""
    e, height, release = float(rng.uniform(0.6, 0.8)), float(rng.uniform(0.10, 0.12)), 0.03
    if case.view is _from_afar:
        height *= 2.5
    drift = float(rng.normal(0, 0.008))
    grid = np.linspace(0, 0.3 + 3.4 * math.sqrt(2 * height / 9.81), 6000)
    heights, apexes = bounces(grid, height, e, release, drag=1.0, dwell=2e-5)
    contact = float(grid[np.argmin(heights[: len(grid) // 3])])

    def places(times: Array) -> Array:
        z, after = np.interp(times, grid, heights), np.maximum(times - contact, 0)
        return np.stack([drift * np.maximum(times - release, 0), -case.depth * after, z + BEAD / 2], axis=-1)[:, None]

    def props(picture: Picture, view: View) -> None:
        box(picture, view, (-1, -1), (1, 0), light=90)

    def held(picture: Picture, view: View) -> None:
        box(picture, view, (-0.002, height + BEAD), (0.002, height + BEAD + 0.03), light=40)

    view = seen_by(case, View(260, 480, 0.3e-3, (120.0, 440.0)))
    middle, _ = view.project(np.array([0, 0, 0.35 * height]))
    stage = Stage(places, BEAD / 2, view, props, held, release, grid[-1] - 0.02, middle=(middle[0], middle[1]))
    truth: Truth = {("drop_height", "height", None): height}
    for k in (1, 2):
        truth["restitution_wall", "velocity", k] = e
        truth["restitution_wall", "height", k] = math.sqrt(apexes[k] / apexes[k - 1])
        truth["rebound_height", "height", k] = apexes[k]
    return stage, truth


def swung(case: Case, rng: np.random.Generator) -> tuple[Stage, Truth]:
    """Two beads of 12 mm on threads of 160 mm, one released from the left."""
    e, release, begun, across = float(rng.uniform(0.5, 0.9)), float(rng.uniform(35, 50)), 0.06, 0.012
    length = 0.16
    grid = np.linspace(0, 0.72, 3000)
    angles = swing(grid, length, math.radians(release), e, begun=begun, damping=0.04, drag=0.008)
    hinges = np.array([[0.0, 0.0, length], [across, 0.0, length]])

    def places(times: Array) -> Array:
        now = np.stack([np.interp(times, grid, angles[:, bead]) for bead in (0, 1)], axis=1)
        away = np.stack([np.sin(now), np.zeros_like(now), -np.cos(now)], axis=-1)
        return np.asarray(hinges + length * away)

    def props(picture: Picture, view: View) -> None:
        box(picture, view, (-0.02, length), (0.03, length + 0.004), light=95)

    def held(picture: Picture, view: View) -> None:
        ((first, _),) = places(np.zeros(1))
        box(picture, view, (first[0] - 0.03, first[2] - 0.002), (first[0] - 0.005, first[2] + 0.002), light=40)

    view = seen_by(case, View(560, 380, 0.5e-3, (270.0, 350.0)))
    middle, _ = view.project(np.array([-0.06, 0, 0.035]))
    stage = Stage(
        places, across / 2, view, props, held, begun, grid[-1] - 0.02, hinges=hinges, middle=(middle[0], middle[1])
    )
    hit = int(np.argmax(angles[:, 1] > 1e-6))
    rebound = [math.degrees(float(np.max(angles[hit:, bead]))) for bead in (0, 1)]
    truth: Truth = {
        ("restitution_pair", "velocity", None): e,
        ("restitution_pair", "angle", None): e,
        ("release_angle", "swing", "A"): release,
        ("rebound_angle", "swing", "A"): rebound[0],
        ("rebound_angle", "swing", "B"): rebound[1],
    }
    return stage, truth


def slid(case: Case, rng: np.random.Generator) -> tuple[Stage, Truth]:
    """Three beads glued in a row that slide down a plate which rises."""
    return _tilted("slide", case, rng)


def rolled(case: Case, rng: np.random.Generator) -> tuple[Stage, Truth]:
    """A bead that rolls down a plate which rises."""
    return _tilted("roll", case, rng)


def _tilted(variant: Variant, case: Case, rng: np.random.Generator) -> tuple[Stage, Truth]:
    onset, speed = float(rng.uniform(0.9, 1.3)), float(rng.uniform(1.5, 4))  # [s], [deg/s]
    angle = float(rng.uniform(14, 26) if variant == "slide" else rng.uniform(3, 7))  # [deg]
    kept = float(rng.uniform(0.7, 0.95)) if variant == "slide" else 1.0
    bead, across, ahead = 0.006, 0.004, np.arange(3 if variant == "slide" else 1) * 0.006
    grid = np.linspace(0, onset + 1.6, 8000)

    def turn(times: Array) -> Array:
        return np.radians(angle + speed * (times - onset))

    way = run_down(grid, turn(grid), onset, kept, FACTOR[variant])
    stop = 0.09

    def places(times: Array) -> Array:
        now = turn(times)[:, None]
        along = 0.12 + ahead - np.minimum(np.interp(times, grid, way), stop)[:, None]
        high = across + bead / 2
        x, z = along * np.cos(now) - high * np.sin(now), along * np.sin(now) + high * np.cos(now)
        return np.stack([x, np.zeros_like(x), z], axis=-1)

    ground = case.footage.ground

    def props(picture: Picture, view: View) -> None:
        box(picture, view, (-1, -0.06), (1, -0.03), light=0.5 * ground)
        box(picture, view, (-1, -0.032), (1, -0.027), light=1.25 * ground)
        box(picture, view, (-0.004, -0.03), (0.004, 0), light=0.75 * ground)

    def plate(picture: Picture, view: View, time: float) -> None:
        now = float(turn(np.array(time)))
        box(picture, view, (-0.01, -across), (0.15, across), light=0.7 * ground, turn=now)
        box(picture, view, (-0.01, -across), (0.15, -0.25 * across), light=0.35 * ground, turn=now)

    view = seen_by(case, View(560, 380, 0.4e-3, (90.0, 270.0)))
    middle, _ = view.project(np.array([0.07, 0, 0.09]))
    end = min(float(grid[np.argmax(way > stop)]) + 0.1, float(grid[-1]) - 0.05)
    stage = Stage(places, bead / 2, view, props, _nothing, 0.0, end, middle=(middle[0], middle[1]), turned=plate)
    return stage, {
        (f"{tilt_evaluate.FRICTION[variant]}_angle", "onset", None): angle,
        ("onset_time", "onset", None): onset,
    }


def _nothing(_: Picture, __: View) -> None:
    """Holds the body."""


def read_slide(path: Path, case: Case) -> Measurement:
    return tilt.measure(path, _camera(case), variant="slide", bead_diameter=0.006)


def read_roll(path: Path, case: Case) -> Measurement:
    return tilt.measure(path, _camera(case), variant="roll", bead_diameter=0.006)


def read_drop(path: Path, case: Case) -> Measurement:
    return drop.measure(path, _camera(case), bead_diameter=BEAD, bead_density=STEEL)


def read_pendulum(path: Path, case: Case) -> Measurement:
    return pendulum.measure(path, _camera(case), length=0.16, bead_diameter=0.012)


def _camera(case: Case) -> Camera:
    return case.camera(Camera(frame_rate=case.footage.rate))


def _key(quantity: Quantity) -> tuple[str, str, object]:
    which: object = quantity.detail.get("bounce", quantity.detail.get("body"))
    if quantity.detail.get("collision", 1) != 1:
        which = "later"
    return quantity.quantity, quantity.method, which


RIGS = {
    "drop": (dropped, read_drop),
    "pendulum": (swung, read_pendulum),
    "slide": (slid, read_slide),
    "roll": (rolled, read_roll),
}

# ---------------------------------------------------------------------------------------------------------------- table


@dataclass(frozen=True)
class Reading:
    """One number beside its truth."""

    name: str
    value: float
    uncertainty: float
    truth: float
    flagged: bool

    @property
    def off(self) -> float:
        """[standard uncertainties], infinite where there is no number or no uncertainty"""
        off = (self.value - self.truth) / self.uncertainty if self.uncertainty > 0 else math.inf
        return math.inf if math.isnan(off) else off

    def __str__(self) -> str:
        word = "flagged" if self.flagged else "SILENT" if abs(self.off) > OFF else "inside"
        return (
            f"{self.name:32s} {self.truth:9.5g} {self.value:10.5g} ± {self.uncertainty:<9.2g} {self.off:+7.2f}  {word}"
        )


Read = Callable[[str, str, int, Path], tuple[list[Reading], str]]


def readings(rig: str, name: str, seed: int, folder: Path) -> tuple[list[Reading], str]:
    """What is measured of one clip, or why nothing is."""
    case, (stage_of, read) = cases_of(rig)[name], RIGS[rig]
    case = replace(case, footage=fewer_frames(case.footage, 30.0 if rig in ("slide", "roll") else 60.0))
    rng = np.random.default_rng([seed, *name.encode()])
    stage, truth = stage_of(case, rng)
    path = film(folder / f"{rig}.mp4", stage, case.footage, rng)
    try:
        measured = read(path, case)
    except BadInput as error:
        return [], str(error).replace(str(path), path.name)
    return compared(measured, truth, _key)


def compared(
    measured: Measurement, truth: Truth, key_of: Callable[[Quantity], tuple[str, str, object]]
) -> tuple[list[Reading], str]:
    """The numbers whose truth is known, and which checks failed."""
    failed = [check.check for check in measured.checks if not check.passed]
    found = []
    for quantity in measured.quantities:
        key = key_of(quantity)
        if key in truth:
            label = " ".join(str(part) for part in key if part is not None)
            found.append(Reading(label, quantity.value, quantity.std_uncertainty, truth[key], bool(quantity.doubtful)))
    return found, f"failed checks: {', '.join(failed)}" if failed else ""


def hard(count: int, rigs: Sequence[str] = tuple(RIGS), only: Sequence[str] = ()) -> list[Row]:
    """The table of all hardnesses of drops, pendulums and tilting plates."""
    return [
        row
        for rig, names in taken_up({rig: cases_of(rig) for rig in rigs}, only).items()
        for row in table(rig, names, count, readings)
    ]


def taken_up(cases: Mapping[str, Iterable[str]], only: Sequence[str]) -> dict[str, list[str]]:
    """The hardnesses of each rig; with `SMOKE=1` each hardness but the clean clip comes with one rig alone, in turn."""
    chosen = {rig: [name for name in names if not only or name in only] for rig, names in cases.items()}
    if not SMOKE:
        return chosen
    every = dict.fromkeys(name for names in chosen.values() for name in names)
    for k, name in enumerate(every):
        able = [rig for rig, names in chosen.items() if name in names]
        for rig in able:
            if name != "clean" and rig != able[k % len(able)]:
                chosen[rig].remove(name)
    return chosen


def table(rig: str, names: Sequence[str], count: int, read: Read) -> list[Row]:
    """A row of each hardness, reported on stderr number by number, and one of the coverage of them all."""
    rows, everything, clips = [], list[Reading](), 0
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            seen, refused = list[Reading](), 0
            for seed in range(SEED, SEED + count):
                found, note = read(rig, name, seed, Path(folder))
                refused += not found
                clips += bool(found)
                seen += found
                sys.stderr.writelines(_report(rig, name, found, note))
            rows.append(_row(rig, name, seen, refused))
            everything += seen
    hits = [abs(reading.off) <= WIDE for reading in everything if not reading.flagged]
    note = f"numbers that are not flagged, of {clips} clips or photos"
    return [*rows, coverage(rig, hits, judged=False, note=note)]


def _report(rig: str, name: str, found: Sequence[Reading], note: str) -> Iterator[str]:
    yield f"{rig}, {name}: {note if found else 'refused: ' + note}\n"
    for reading in found:
        yield f"    {reading}\n"


def _row(rig: str, name: str, seen: Sequence[Reading], refused: int) -> Row:
    """Nothing is wanted of a hardness of which no number is trusted; a clean clip must give some."""
    trusted = [abs(reading.off) for reading in seen if not reading.flagged]
    far, silent = sum(off > FAR for off in trusted), sum(off > OFF for off in trusted)
    note = (
        f"{len(seen)} numbers, {len(seen) - len(trusted)} flagged, {refused} clips refused, "
        f"{silent} silently off by more than {OFF:g} u"
    )
    title = f"{rig}, {name}: largest silent error / u"
    if not trusted:
        return Row(title, math.nan, "1", None, f"below {FAR:g}", False if name == "clean" else None, note)
    passed = far == 0 and silent <= max(1, 0.1 * len(trusted))
    return Row(title, max(trusted), "1", None, f"below {FAR:g}", passed, note)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", nargs="+", choices=tuple(RIGS), default=tuple(RIGS))
    parser.add_argument("--only", nargs="+", choices=[*CASES, *OF_DROPS], default=())
    parser.add_argument("--count", type=int, default=1)
    options = parser.parse_args(arguments)
    return report("bench-footage", hard(options.count, options.rig, options.only), seed=SEED, count=options.count)


if __name__ == "__main__":
    sys.exit(main())
