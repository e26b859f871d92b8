"""Verdicts on labs with many particles that LIGGGHTS has made: piles, packings, drums, hoppers, pairs and two sizes.

    python benchmarks/diagnose/bulk.py --seed 7 --count 20

A lab states one material and one or two rigs of some 500 to 800 beads, with three repetitions; LIGGGHTS computes them
with one thing otherwise than stated, or, in each fourth lab, with nothing.  Stated coefficients, scale and camera are a
little off within their uncertainties, also in labs without an effect.  Labs of one seed state the same material, and
their twins are kept in one store, as a campaign on one material would.  Whether an effect is visible at all is judged
without rigtwin's twins, by labs that LIGGGHTS makes exactly as stated: an effect that changes no number by more than
`VISIBLE` standard errors is counted apart.  Finished labs and answers are kept in ``out/bench-diagnose-bulk``, so that
the benchmark continues; delete the folder to begin anew.  Also `SEED=`, `COUNT=` and `WORKERS=` in the environment.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.benchmarks.engine.decks import BINARY, run_deck
from rigtwin.benchmarks.figures import OUT, SMOKE, Row, report, skipped, small
from rigtwin.compare.diagnose.bulk.observables import features_of, of_record
from rigtwin.compare.diagnose.bulk.read_bulk_json import read_bulk_lab
from rigtwin.compare.diagnose.diagnose_folder import diagnose_folder
from rigtwin.compare.twins.imported import imported_twin
from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.camera import Camera
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rigs import DrumSettings, HopperSettings, PackingSettings, PileSettings, RigSettings
from rigtwin.sim.decks.deck import Deck

TARGET = "bench-diagnose-bulk"
FOLDER = OUT / TARGET
REPETITIONS = small(3, 2)
PIXEL, NOISE = 3e-4, 0.4  # [m], and standard deviation of an edge in pixels
MODULUS = 1e7  # [Pa]
VISIBLE = 6.0  # standard errors of the difference of two means of three, which with 4 degrees of freedom has p = 0.004
BED_READ = 0.25  # [bead diameters], by which this lab reads a bed higher than the mean of its surface


@dataclass(frozen=True)
class World:
    """All that LIGGGHTS and the camera are given."""

    diameter: float  # [m]
    density: float
    friction: float
    wall_friction: float
    restitution: float = 0.75
    wall_restitution: float = 0.6
    rolling: float = 0.0  # in LIGGGHTS's convention
    end_friction: float | None = None
    cohesion: float = 0.0  # [J/m^3]
    spread: float = 0.0  # relative standard deviation of the diameters
    lift: float = 1.0
    roll: float = 0.0  # [rad]
    scale: float = 0.0
    clock: float = 0.0
    delay: float = 0.0  # [s]


Rig = tuple[str, RigSettings, float]
"""Name of a condition, its settings, and the size of its beads over the usual one."""
RIGS: dict[str, Rig] = {
    "pile": ("pile", PileSettings(0.09, 0.005, count=550, variant="pouring", tube_diameter=0.058,
                                  lift_speed=0.12), 1.0),
    "wide pile": ("wide pile", PileSettings(0.11, 0.005, count=800, variant="pouring", tube_diameter=0.07,
                                            lift_speed=0.12), 1.0),
    "fine pile": ("fine pile", PileSettings(0.06, 0.0033, count=550, variant="pouring",
                                            tube_diameter=0.0387, lift_speed=0.12), 0.667),
    "packing": ("packing", PackingSettings(0.05, count=small(500, 60)), 1.0),
    "wide packing": ("wide packing", PackingSettings(0.065, count=small(700, 60)), 1.0),
    "drum": ("drum", DrumSettings(0.1, 1.5, 0.036, count=600), 1.0),
    "narrow drum": ("narrow drum", DrumSettings(0.1, 1.5, 0.02, count=330), 1.0),
    "hopper": ("hopper", HopperSettings("conical", 0.08, outlet=0.034, cone_height=0.05, count=600), 1.0),
    "wide hopper": ("wide hopper", HopperSettings("conical", 0.08, outlet=0.042, cone_height=0.05,
                                                  count=600), 1.0),
}  # fmt: skip
KINDS: dict[str, tuple[str, ...]] = {
    "pile": ("pile", "wide pile"),
    "hopper": ("hopper", "wide hopper"),
    "drum": ("drum", "narrow drum"),
    "packing": ("packing", "wide packing"),
    "pile of two sizes": ("pile", "fine pile"),
    "packing and pile": ("packing", "pile"),
    "drum and hopper": ("drum", "hopper"),
    "pile and hopper": ("pile", "hopper"),
}
CLEARER = ("pile of two sizes", "packing and pile", "drum and hopper", "pile and hopper")


def _factor(random: np.random.Generator, low: float, high: float) -> float:
    """A factor between two, up or down."""
    found = random.uniform(low, high)
    return found if random.random() < 0.5 else 1 / found


def _either(random: np.random.Generator, low: float, high: float) -> float:
    return float(random.uniform(low, high) * random.choice([-1, 1]))


Change = Callable[[World, np.random.Generator], World]
EFFECTS: dict[str, tuple[tuple[str, ...], Change]] = {
    "rolling_resistance": (
        ("pile", "packing", "drum", "hopper"), lambda w, r: replace(w, rolling=r.uniform(0.06, 0.25))
    ),
    "sliding_friction": (
        ("pile", "packing", "drum", "hopper"),
        lambda w, r: replace(w, friction=w.friction * r.choice([r.uniform(0.35, 0.55), r.uniform(1.8, 2.5)])),
    ),
    "cohesion_sjkr": (
        ("pile", "packing", "drum", "hopper"), lambda w, r: replace(w, cohesion=r.uniform(1.6e5, 2.6e5))
    ),
    "particle_size": (("pile", "packing"), lambda w, r: replace(w, diameter=w.diameter * (1 + _either(r, 0.04, 0.07)))),
    "particle_density": (
        ("pile", "packing", "hopper"), lambda w, r: replace(w, density=w.density * (1 + _either(r, 0.06, 0.12)))
    ),
    "wall_friction": (
        ("packing", "hopper", "drum"), lambda w, r: replace(w, wall_friction=w.wall_friction * r.uniform(0.15, 0.35))
    ),
    "end_wall_friction": (("drum",), lambda w, r: replace(w, end_friction=0.1 * w.wall_friction)),
    "lift_speed": (("pile",), lambda w, r: replace(w, lift=_factor(r, 2.0, 3.0))),
    "camera_roll": (("pile", "drum"), lambda w, r: replace(w, roll=math.radians(_either(r, 3.0, 6.0)))),
    "scale_error": (("pile", "packing"), lambda w, r: replace(w, scale=_either(r, 0.04, 0.08))),
    "frame_rate_error": (("hopper",), lambda w, r: replace(w, clock=_either(r, 0.08, 0.2))),
    "opening_delay": (("hopper",), lambda w, r: replace(w, delay=r.uniform(0.08, 0.25))),
}  # fmt: skip
"""Rigs in which an effect is drawn, and what it changes."""
OF_THE_MASS = ("particle_size", "particle_density")


@dataclass(frozen=True)
class Case:
    """A lab to be drawn."""

    number: int
    kind: str
    effect: str  # empty for a lab without one
    stated: World
    true: World


def cases(seed: int, count: int) -> list[Case]:
    """The labs of a seed, each fourth without an effect; kinds take turns."""
    shared = np.random.default_rng(seed)
    stated = World(
        0.006, float(shared.uniform(1100, 2400)), float(shared.uniform(0.3, 0.5)), float(shared.uniform(0.3, 0.5)),
        float(shared.uniform(0.65, 0.8)), float(shared.uniform(0.5, 0.7)),
    )  # fmt: skip
    found, turn = [], 0
    names, kinds = list(EFFECTS), small(list(KINDS), ["packing"])  # a bed settles soonest
    for number in range(count):
        random = np.random.default_rng([seed, number])
        kind = kinds[number % len(kinds)]
        true = _as_any_lab(stated, random)
        effect = ""
        if number % 4 != 3 - (number // len(KINDS)) % 4:
            rigs = {RIGS[name][1].name for name in KINDS[kind]}
            while not rigs & set(EFFECTS[names[turn % len(names)]][0]):
                turn += 1
            effect = names[turn % len(names)]
            turn += 1
            true = EFFECTS[effect][1](true, random)
        found.append(Case(number, kind, effect, stated, true))
    return found


def _as_any_lab(stated: World, random: np.random.Generator) -> World:
    """The stated world with small errors inside the stated uncertainties."""
    return replace(
        stated,
        friction=stated.friction + random.normal(0, 0.012),
        wall_friction=stated.wall_friction + random.normal(0, 0.012),
        diameter=stated.diameter * (1 + random.normal(0, 0.002)), scale=random.normal(0, 0.002),
        roll=math.radians(random.normal(0, 0.1)), clock=random.normal(0, 1e-4),
    )  # fmt: skip


def computed(rig: Rig, world: World, seed: int) -> tuple[Twin, Experiment]:
    """What LIGGGHTS makes of a rig."""
    name, settings, size = rig
    bead = Particle("bead", Material("bead", world.density, MODULUS, 0.3), size * world.diameter)
    wall = Material("wall", world.density, MODULUS, 0.3)
    if isinstance(settings, PileSettings):
        settings = replace(settings, lift_speed=(settings.lift_speed or 0.0) * world.lift)
    experiment = Experiment(name, settings, bead, wall, Camera(), ())
    like = Contact(world.restitution, world.friction, world.rolling / 2)
    at_wall = Contact(world.wall_restitution, world.wall_friction, world.rolling)
    count = entry_of(experiment).count(experiment, None)  # type: ignore[attr-defined]
    deck = Deck("liggghts", settings.rig(), bead, wall, like, at_wall, count, seed, stiffness_factor=1.0)  # type: ignore[arg-type]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for file, text in changed(deck.files(), world).items():
            (folder / file).write_text(text)
        run_deck(deck, folder)
        return imported_twin(folder), experiment


def changed(files: Mapping[str, str], world: World) -> dict[str, str]:
    """A deck with cohesion, or with end walls of a material of their own."""
    found = dict(files)
    if world.cohesion:
        for name in ("contacts.in", "in.liggghts"):
            found[name] = found[name].replace("tangential history", "tangential history cohesion sjkr")
        pairs = " ".join([f"{world.cohesion:.10g}"] * 4)
        line = f"fix cohesionEnergyDensity all property/global cohesionEnergyDensity peratomtypepair 2 {pairs}\n"
        found["contacts.in"] = found["contacts.in"].replace("pair_style", line + "pair_style", 1)
    if world.end_friction is not None and "front.stl" in found:
        found["beads.data"] = found["beads.data"].replace("2 atom types", "3 atom types")
        text = re.sub(r"peratomtype (\S+) (\S+)", r"peratomtype \1 \2 \2", found["contacts.in"])
        text = re.sub(r"peratomtypepair 2 (\S+) (\S+) \S+ \S+", r"peratomtypepair 3 \1 \2 \2 \2 \2 \2 \2 \2 \2", text)
        ends = f"{world.end_friction:.10g}"
        text = re.sub(
            r"(coefficientFriction peratomtypepair 3 \S+ \S+) \S+ (\S+ \S+ \S+) \S+ (\S+ \S+)",
            rf"\1 {ends} \2 {ends} \3", text,
        )  # fmt: skip
        found["contacts.in"] = text
        for wall in ("front", "back"):
            found["in.liggghts"] = found["in.liggghts"].replace(f"{wall}.stl type 2", f"{wall}.stl type 3")
    return found


def write_repetition(
    folder: Path, twin: Twin, experiment: Experiment, world: World, random: np.random.Generator
) -> None:
    """Profile or discharge, and results, as the camera with its errors sees them."""
    folder.mkdir(parents=True, exist_ok=True)
    bead = experiment.particle
    settings = twin.settings
    count = entry_of(experiment).count(experiment, None)  # type: ignore[attr-defined]
    results = {"total_mass_g": 1e3 * count * bead.mass + random.normal(0, 0.02)}
    if experiment.rig_name == "hopper":
        series = twin.series[0]
        time = np.arange(0.0, float(series.time[-1]) + world.delay, 1 / 60)
        left = np.interp(time - world.delay, series.time, series.value, left=series.value[0])
        rows = np.column_stack([time * (1 + world.clock), 1e3 * (left[0] - left) + random.normal(0, 0.02, len(time))])
        np.savetxt(folder / "discharge.csv", rows, fmt="%.6f", delimiter=",", header="time_s,mass_g", comments="")
    else:
        profile = twin.profiles[int(random.integers(len(twin.profiles)))]
        known = np.isfinite(profile.height)
        x, y = profile.x[known], profile.height[known]
        turn = world.roll
        across, up = (x * math.cos(turn) + y * math.sin(turn)), (y * math.cos(turn) - x * math.sin(turn))
        at = np.arange(across.min(), across.max(), PIXEL)
        seen = np.interp(at, across, up)
        rows = (1 + world.scale) * np.column_stack([at, seen])
        rows[:, 1] += random.normal(0, NOISE * PIXEL, len(rows))
        if experiment.rig_name == "pile":
            rows[:, 1] = np.maximum(rows[:, 1], 0.0)
        if experiment.rig_name != "packing":
            np.savetxt(folder / "profile.csv", rows, fmt="%.6f", delimiter=",", header="x_m,height_m", comments="")
    bed = settings.get("bed_height_m", settings.get("surface_height_m"))
    if bed is not None:
        results["bed_height_m"] = (1 + world.scale) * (bed + BED_READ * bead.diameter) + random.normal(0, 1e-4)
    if "fallen" in settings:
        results["particles_on_base"] = settings["placed"] - settings["fallen"]
    (folder / "results.json").write_text(json.dumps(results))


def document(case: Case) -> dict[str, Any]:
    """The lab.json of a case."""
    stated = case.stated
    conditions = []
    for key in KINDS[case.kind]:
        name, rig, size = RIGS[key]
        given: dict[str, Any] = {"name": name.replace(" ", "_"), "rig": rig.name, "repetitions": REPETITIONS}
        given["bead"] = "bead" if size == 1 else "fine"
        given |= {STATED_AS[rig.name][k]: v for k, v in vars(rig).items() if k in STATED_AS[rig.name] and v is not None}
        conditions.append(given)
    kinds = {"bead" if RIGS[key][2] == 1 else "fine": RIGS[key][2] for key in KINDS[case.kind]}
    return {
        "case": f"lab {case.number}: {case.kind}",
        "rig": conditions[0]["rig"],
        "gravity_m_s2": 9.81,
        "particles": {
            name: {
                "diameter_m": size * stated.diameter, "diameter_uncertainty_m": 5e-5 * size,
                "density_kg_m3": stated.density, "youngs_modulus_Pa": MODULUS, "poissons_ratio": 0.3,
            }
            for name, size in kinds.items()
        },
        "contact": {
            "restitution_pp": stated.restitution, "restitution_pw": stated.wall_restitution,
            "static_friction_pp": stated.friction, "static_friction_pw": stated.wall_friction,
            "rolling_friction": None, "friction_uncertainty": 0.02, "restitution_uncertainty": 0.02,
            "rolling_friction_note": "limit torque = rolling_friction * R_eff * normal force; null = not measured",
        },
        "camera": {"scale_m_per_px": PIXEL, "scale_uncertainty_rel": 0.003, "edge_noise_px": NOISE},
        "conditions": conditions,
    }  # fmt: skip


STATED_AS = {
    "pile": {
        "base_diameter": "base_diameter_m", "rim_height": "rim_height_m", "tube_diameter": "cylinder_inner_diameter_m",
        "count": "particle_count", "lift_speed": "lift_speed_m_s",
    },
    "packing": {"cylinder_diameter": "cylinder_inner_diameter_m", "count": "particle_count"},
    "drum": {
        "drum_diameter": "drum_diameter_m", "depth": "drum_length_m", "speed": "rotation_speed_rad_s",
        "count": "particle_count",
    },
    "hopper": {
        "outlet": "outlet_diameter_m", "bin_width": "bin_diameter_m", "cone_height": "cone_height_m",
        "count": "particle_count",
    },
}  # fmt: skip


def make_lab(folder: Path, case: Case, seed: int) -> None:
    """Compute and write a lab that is not there yet; the truth is written last."""
    if (folder / "truth.json").is_file():
        return
    random = np.random.default_rng([seed, case.number, 1])
    for place, key in enumerate(KINDS[case.kind]):
        name = RIGS[key][0].replace(" ", "_")
        for k in range(REPETITIONS):
            twin, experiment = computed(RIGS[key], case.true, 9000 + 1000 * seed + 100 * case.number + 10 * place + k)
            write_repetition(folder / "lab" / name / f"rep{k + 1:02d}", twin, experiment, case.true, random)
    (folder / "lab" / "lab.json").write_text(json.dumps(document(case), indent=1))
    truth = {"effect": case.effect, "kind": case.kind, "stated": vars(case.stated), "true": vars(case.true)}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))


def visibility(folder: Path, case: Case, seed: int) -> float:
    """Largest change of a number of a lab by its effect, in standard errors, with LIGGGHTS on both sides."""
    as_stated = FOLDER / f"stated-{seed}-{case.kind.replace(' ', '-')}"
    make_lab(as_stated, Case(900 + list(KINDS).index(case.kind), case.kind, "", case.stated, case.stated), seed)
    most = 0.0
    labs = [read_bulk_lab(one / "lab") for one in (folder, as_stated)]
    for condition, stated in zip(*(lab.conditions for lab in labs), strict=True):
        both = [[of_record(condition, record, mirrored=False) for record in one.records] for one in (condition, stated)]
        features = features_of(condition, both[0], [*both[0], *both[1]])
        with_it, without = (np.array([features.of(look) for look in looks]) for looks in both)
        error = np.sqrt((with_it.var(axis=0, ddof=1) + without.var(axis=0, ddof=1)) / REPETITIONS)
        change = np.abs(with_it.mean(axis=0) - without.mean(axis=0))
        if case.effect not in OF_THE_MASS:  # which sizes within their stated uncertainty change visibly, too
            change[[name == "total_mass" for name in features.names]] = 0.0
        most = max(most, float(np.nanmax(np.divide(change, error, out=0 * change, where=error > 0))))
    return most


def answer(folder: Path, case: Case, seed: int, workers: int) -> dict[str, Any]:
    """The answer to a lab, and whether it is right; read where it was given before."""
    kept = folder / "answer.json"
    if kept.is_file():
        return dict(json.loads(kept.read_text()))
    make_lab(folder, case, seed)
    begun = time.perf_counter()
    found, _ = diagnose_folder(folder / "lab", folder / "diagnosis", store=FOLDER / f"runs-{seed}", workers=workers)
    said = found.to_json()
    names = [one["effect"] for one in said["effects"]]
    result = {
        "case": case.number, "kind": case.kind, "effect": case.effect, "verdict": said["verdict"], "names": names,
        "set": said["indistinguishable"][0] if said["indistinguishable"] else names,
        "next": said["next_experiment"], "gap": said["gap"], "reason": said["reason"],
        "seconds": time.perf_counter() - begun, "twins": said["twins"], "visibility": visibility(folder, case, seed),
        "gains": {" + ".join(one["effects"]): round(one["gain"], 1) for one in said["tried"][:8]},
    }  # fmt: skip
    kept.write_text(json.dumps(result, indent=1))
    return result


def is_right(one: Mapping[str, Any], *, alone: bool = False) -> bool:
    """The name, or (unless `alone`) a set with it and an experiment that separates it."""
    if not one["effect"]:
        return bool(one["verdict"] == "none")
    if one["verdict"] == "named":
        return bool(one["names"] == [one["effect"]])
    return not alone and one["verdict"] == "indistinguishable" and one["effect"] in one["set"] and bool(one["next"])


def in_words(one: Mapping[str, Any]) -> str:
    said = ", ".join(one["set"]) or one["verdict"]
    how = f", visible by {one['visibility']:.0f} standard errors" if one["effect"] else ""
    mark = "right" if is_right(one) else "WRONG" if not one["effect"] or one["visibility"] > VISIBLE else "not seen"
    return f"{mark} {one['kind']}: {one['effect'] or 'none'}{how}: {one['verdict']} {said}"


def held_out(found: Sequence[Mapping[str, Any]]) -> list[float]:
    """Share of the excess gap that is closed on a condition that was not fitted, where it had one."""
    shares = []
    for one in found:
        gap = one["gap"]
        before, after = gap["condition_before"], gap["condition_after"]
        if one["effect"] and is_right(one) and before is not None and before > 1.5:
            shares.append(1 - max(after - 1, 0.0) / (before - 1))
    return shares


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED", "1")))
    parser.add_argument("--count", type=int, default=int(os.environ.get("COUNT") or small("16", "1")))
    parser.add_argument("--workers", type=int, default=int(os.environ.get("WORKERS", "2")))
    given = parser.parse_args()
    if shutil.which(BINARY["liggghts"]) is None:
        return report(TARGET, [skipped("verdicts", "liggghts is not installed")] * 6)
    found = []
    for case in cases(given.seed, given.count):
        folder = FOLDER / f"lab-{given.seed}-{case.number:02d}"
        found.append(answer(folder, case, given.seed, given.workers))
        sys.stderr.write(f"{in_words(found[-1])}; {found[-1]['seconds']:.0f} s\n")
    hidden = [one for one in found if one["effect"] and one["visibility"] <= VISIBLE]
    real = [one for one in found if one["effect"] and one["visibility"] > VISIBLE]
    nulls = [one for one in found if not one["effect"]]
    clearer = [one for one in real if one["kind"] in CLEARER]
    closed = held_out(found)

    def share(name: str, good: int, of: int, wanted: str, enough: Callable[[float], bool], note: str = "") -> Row:
        if not of:
            return skipped(name, "no such lab was drawn")
        value = 100 * good / of
        return Row(name, value, "%", None, wanted, None if SMOKE else enough(value), note or f"{good} of {of}")

    rows = [
        share("right name or set", sum(map(is_right, real)), len(real), "at least 85", lambda v: v >= 85),
        share(
            "right name with two sizes or two rigs", sum(is_right(one, alone=True) for one in clearer), len(clearer),
            "at least 85", lambda v: v >= 85,
        ),
        share("labs without an effect that are named", sum(not is_right(one) for one in nulls), len(nulls),
              "at most 5", lambda v: v <= 5),
        Row(
            "labs whose effect changes nothing visible", len(hidden),
            note=f"{sum(one['verdict'] == 'none' for one in hidden)} none, {sum(map(is_right, hidden))} right",
        ),
        Row(
            "excess gap closed on a held-out condition, median", 100 * float(np.median(closed)), "%", None,
            "at least 80", None if SMOKE else 100 * float(np.median(closed)) >= 80, f"{len(closed)} labs",
        ) if closed else skipped("excess gap closed on a held-out condition", "no lab had one"),
        Row("longest diagnosis", max(one["seconds"] for one in found) / 60, "min", None, "at most 30",
            None if SMOKE else max(one["seconds"] for one in found) <= 1800),
        Row("most twins of a lab", max(one["twins"] for one in found)),
        *(Row(f"lab {one['case']}", float(is_right(one)), note=in_words(one)) for one in found),
    ]  # fmt: skip
    return report(TARGET, rows)


if __name__ == "__main__":
    sys.exit(main())
