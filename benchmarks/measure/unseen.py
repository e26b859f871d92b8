"""Measuring media that nothing was developed on: the share of right, doubtful and silently wrong numbers.

    python benchmarks/measure/unseen.py --media DIR [--only NAME ...] [--stated] [--json FILE]

`DIR` holds one folder per clip or photo with `given.json` (what its user states) and `truth.json`.  With `--stated` the
base line of every heap and the walls of every bed are stated, too, as a user would click them: the true places with a
seeded error of 2 px.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import rigtwin
from rigtwin.lab.errors import BadInput
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.records import Profile
from rigtwin.measure.pile import repose_angles

SEED = 1
CLICK = 2.0  # [px], standard deviation of a stated point
WIDE, SILENT = 1.959964, 2.6  # standard uncertainties of a 95 % interval, and of a number that is silently wrong

JsonObject = Mapping[str, Any]


@dataclass(frozen=True)
class Target:
    """A number of the truth, the quantity that should show it, and how far off it may be."""

    name: str
    quantity: str
    method: str
    detail: JsonObject
    truth: float
    tolerance: float
    unit: str


@dataclass(frozen=True)
class Outcome:
    media: str
    name: str
    unit: str
    truth: float
    tolerance: float
    value: float = math.nan  # NaN: refused
    sigma: float = math.nan
    doubtful: str = ""  # or the refusal
    seconds: float = 0.0

    @property
    def measured(self) -> bool:
        return math.isfinite(self.value)

    @property
    def error(self) -> float:
        return self.value - self.truth

    @property
    def right(self) -> bool:
        return abs(self.error) <= self.tolerance

    @property
    def silent(self) -> bool:
        return self.measured and not self.doubtful and abs(self.error) > SILENT * self.sigma


def targets(kind: str, truth: JsonObject) -> Iterator[Target]:
    """Headline numbers of the truth."""
    mean, first = {"side": "mean"}, {"bounce": 1}
    if kind == "pile":
        graphical, geometric = "angle_of_repose_graphical", truth["geometric_2h_over_D_base_deg"]
        if "profile_x_m" in truth:
            yield Target("graphical", graphical, "line 20-80 %", mean, _line_of_outline(truth), 1.5, "deg")
        regression = truth["fit20_80_mean_deg"]
        yield Target("graphical (regression)", graphical, "line 20-80 %", mean, regression, 1.5, "deg")
        yield Target("geometric", "angle_of_repose_geometric", "apex", mean, geometric, 1.0, "deg")
    elif kind == "packing":
        quarter = truth["bead_diameter_m"] / 4
        yield Target("bed height", "bed_height", "", {}, truth["bed_height_m"], quarter, "m")
        if "outline_height_m" in truth:
            yield Target("bed outline", "bed_height", "outline", {}, truth["outline_height_m"], quarter, "m")
    elif kind == "tilt":
        yield Target("onset", "", "onset", {}, truth["alpha_onset_deg"], 0.2, "deg")
    elif kind == "drop":
        yield Target("restitution", "restitution_wall", "velocity", first, truth["cor_contact"][0], 0.005, "1")
    elif kind == "pendulum":
        yield Target("restitution", "restitution", "", {}, truth["e"], 0.01, "1")
    elif kind == "drum":
        middle = "line, middle half"
        yield Target("dynamic angle", "angle_of_repose_graphical", middle, {}, truth["dynamic_aor_deg"], 1.0, "deg")
    elif kind == "hopper":
        duration = truth["discharge_time_s"]
        yield Target("discharge time", "discharge_time", "", {}, duration, 0.02 * duration, "s")


def _line_of_outline(truth: JsonObject) -> float:
    """Graphical angle [deg] of the true outline by the definition of `measure`.

    The truth's own angle is a regression over all points between the two heights, which is up to 2 degrees flatter on a
    rough flank: it leaves out the high points of low grains and the low points of high ones.
    """
    x, height = (np.array([value or 0.0 for value in truth[key]]) for key in ("profile_x_m", "profile_h_m"))
    heap = repose_angles.find_parts(Profile(x, height, np.zeros(len(x))), None, truth["bead_diameter_m"])
    if heap is None:
        raise ValueError("the true outline shows no heap")
    lines = [repose_angles.flank_line(heap, side, (0.2, 0.8)) for side in repose_angles.SIDES]
    return float(np.mean([line.angle for line in lines if line is not None]))


def settings(kind: str, given: JsonObject) -> dict[str, str]:
    """Options of `rigtwin measure KIND` from what the user states."""
    stated = {
        "bead_diameter": ("bead_diameter_mm", "mm"),
        "bead_mass": ("bead_mass_g", "g"),
        "base_diameter": ("base_diameter_mm", "mm"),
        "cylinder_diameter": ("cylinder_inner_diameter_mm", "mm"),
        "total_mass": ("total_mass_g", "g"),
        "frame_rate": ("capture_fps", "Hz"),
        "length": ("pendulum_length_mm", "mm"),
        "drum_diameter": ("drum_inner_diameter_mm", "mm"),
        "speed": ("rpm", "rpm"),
        "bin_width": ("bin_inner_width_mm", "mm"),
    }
    known = {
        "pile": ("base_diameter", "bead_diameter"),
        "packing": ("cylinder_diameter", "total_mass", "bead_diameter"),
        "tilt": ("bead_diameter", "frame_rate"),
        "drop": ("bead_diameter", "bead_mass", "frame_rate"),
        "pendulum": ("length", "bead_diameter", "bead_mass", "frame_rate"),
        "drum": ("drum_diameter", "speed", "bead_diameter", "frame_rate"),
        "hopper": ("bin_width", "bead_diameter", "frame_rate"),
    }[kind]
    options = {
        option: f"{given[key]} {unit}"
        for option in known
        for key, unit in [stated[option]]
        if isinstance(given.get(key), int | float)  # "about 25, variable" is no frame rate to state
    }
    if kind == "tilt":
        options["variant"] = "roll" if "roll" in str(given.get("test", "")) else "slide"
    if kind == "pendulum":
        options["variant"] = "wall" if given.get("wall_material") else "double"
    return options


def clicks(truth: JsonObject, given: JsonObject, rng: np.random.Generator) -> dict[str, str]:
    """Options and places as clicked [px]."""
    kind, more = given["kind"], dict[str, str]()
    if kind == "pile":
        option, ends = "base", np.array([*truth["base_left_px"], *truth["base_right_px"]])
    elif kind == "packing":
        option = "cylinder"
        if "wall_left_px" in truth:
            away = (np.array(truth["wall_right_px"]) - np.array(truth["wall_left_px"])) / 2
        else:
            roll = math.radians(truth["camera_roll_deg"])
            away = (
                truth["cylinder_radius_m"] / truth["m_per_px_axis_plane"] * np.array([math.cos(roll), math.sin(roll)])
            )
        axis = np.array(truth["floor_px_axis"])
        ends = np.concatenate([axis - away, axis + away])
    elif kind == "tilt":
        _, angle, _, x, y = truth["rows"][0]
        turn = -math.radians(angle + truth["camera_roll_deg"])
        # the surface is half a bead below the body's centre; seen from the hinge to the body
        below = given["bead_diameter_mm"] / 2000 / truth["m_per_px_bead_plane"]
        under = np.array([x - below * math.sin(turn), y + below * math.cos(turn)])
        back = (truth["hinge_px"][0] - x) * np.array([1.0, math.tan(turn)])
        ends = np.concatenate(sorted([under, under + back], key=lambda end: float(end[0])))
        at = np.array([x, y]) + rng.normal(0.0, CLICK, 2)
        option, more = "plate", {"bead_at": f"0:{at[0]:.1f},{at[1]:.1f}"}
    else:
        return {}
    return more | {option: ",".join(f"{value:.1f}" for value in ends + rng.normal(0.0, CLICK, 4))}


def outcomes(folder: Path, *, by_hand: bool) -> list[Outcome]:
    given = json.loads((folder / "given.json").read_text())
    truth = json.loads((folder / "truth.json").read_text())
    kind = given["kind"]
    options = settings(kind, given)
    if by_hand:
        # every folder has its own sequence, so that --only does not change the clicks
        seed = np.random.SeedSequence([SEED, *folder.name.encode()])
        options |= clicks(truth, given, np.random.default_rng(seed))
    wanted = list(targets(kind, truth))
    blank = [Outcome(folder.name, one.name, one.unit, one.truth, one.tolerance) for one in wanted]
    start = time.process_time()
    try:
        measured = rigtwin.measure(kind, folder / given["file"], **options)
    except BadInput as refusal:
        return [Outcome(**{**asdict(one), "doubtful": f"refused: {refusal}"}) for one in blank]
    seconds = time.process_time() - start
    found = []
    for target, one in zip(wanted, blank, strict=True):
        quantity = _matching(measured.quantities, target)
        seen = {} if quantity is None else {"value": quantity.value, "sigma": quantity.std_uncertainty}
        doubtful = "not among the quantities" if quantity is None else quantity.doubtful
        found.append(Outcome(**{**asdict(one), **seen, "doubtful": doubtful, "seconds": seconds}))
    return found


def _matching(quantities: Sequence[Quantity], target: Target) -> Quantity | None:
    """The first quantity with the name (or its beginning), unit, method and details of the target."""
    for one in quantities:
        if (
            one.quantity.startswith(target.quantity)
            and one.unit == target.unit
            and target.method in ("", one.method)
            and all(one.detail.get(key) == value for key, value in target.detail.items())
        ):
            return one
    return None


def summary(found: Sequence[Outcome]) -> pd.DataFrame:
    """One line per kind of number: how many are right, doubtful, covered and silently wrong."""
    lines = {}
    for name in dict.fromkeys(one.name for one in found):
        ones = [one for one in found if one.name == name]
        seen = [one for one in ones if one.measured]
        lines[name] = {
            "numbers": len(ones),
            "measured": len(seen),
            "right": sum(one.right for one in seen),
            "doubtful": sum(bool(one.doubtful) for one in seen),
            "right but doubtful": sum(one.right and bool(one.doubtful) for one in seen),
            "within 95 %": sum(abs(one.error) <= WIDE * one.sigma for one in seen),
            "silently wrong": sum(one.silent for one in seen),
        }
    return pd.DataFrame.from_dict(lines, orient="index")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--media", type=Path, required=True, help="folder of folders with given.json and truth.json")
    parser.add_argument("--only", nargs="*", default=[], help="beginnings of the folders' names")
    parser.add_argument("--stated", action="store_true", help="state base lines and walls")
    parser.add_argument("--json", type=Path, help="write every number into this file")
    asked = parser.parse_args(arguments)
    folders = sorted(file.parent for file in asked.media.glob("*/truth.json") if (file.parent / "given.json").exists())
    found: list[Outcome] = []
    for folder in folders:
        if asked.only and not folder.name.startswith(tuple(asked.only)):
            continue
        for one in outcomes(folder, by_hand=asked.stated):
            mark = "SILENT" if one.silent else "right" if one.right else "wrong" if one.measured else "-"
            print(  # noqa: T201
                f"{one.media:14} {one.name:14} {one.value:9.4g} truth {one.truth:9.4g} error {one.error:+8.3g} "
                f"sigma {one.sigma:7.2g} {one.unit:3} {mark:6} {one.seconds:5.1f} s  {one.doubtful}",
                flush=True,
            )
            found.append(one)
    print(summary(found).to_string())  # noqa: T201
    if asked.json is not None:
        asked.json.write_text(json.dumps([asdict(one) for one in found], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
