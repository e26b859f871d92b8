"""Labs with a hidden effect whose physics shares no code with rigtwin's models: drawn by seed, with a sealed truth.

    python benchmarks/diagnose/independent_labs.py --seed 7 --count 30 --out DIR [--kind null] [--rig drop] [--effect X]

writes the same files as `draw_labs`.  The equations of motion, the laws of each effect (two or more, one is drawn) and
the camera are those of the modules `independent_labs_*`.  How strong an effect is follows from what it would gain in
chi-square over the best plain model (`independent_labs_gain`):

- ``near``: 16 to 40, at the limit of what can be found; its size is set so
- ``moderate``: 80 to 600, four times that limit and more; its size is set so
- ``strong``: above 600, of the size that a real lab may have; where that shows less, ``moderate``

What nature sets (the drag of air, say) keeps its size: beads make the strength, and another bench is drawn where the
effect is near the limit and should not be, or the other way round.  Of two effects at
once each is weighed alone, and the weaker one makes the class.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.benchmarks.diagnose import independent_labs_double as double
from rigtwin.benchmarks.diagnose import independent_labs_drop as drop
from rigtwin.benchmarks.diagnose import independent_labs_pendulum as pendulum
from rigtwin.benchmarks.diagnose import independent_labs_roll as roll
from rigtwin.benchmarks.diagnose import independent_labs_slide as slide
from rigtwin.benchmarks.diagnose.independent_labs_effects import ALL, LISTED, PAIRS, UNLISTED
from rigtwin.benchmarks.diagnose.independent_labs_film import (
    CAMERA,
    CLOCK_UNCERTAINTY,
    ROLL_UNCERTAINTY,
    SCALE_UNCERTAINTY,
    film,
)
from rigtwin.benchmarks.diagnose.independent_labs_gain import Strength
from rigtwin.benchmarks.diagnose.independent_labs_spheres import DIAMETER_UNCERTAINTY
from rigtwin.benchmarks.diagnose.independent_labs_types import (
    GRAVITY,
    Array,
    Chance,
    Condition,
    Hidden,
    Lab,
    Rng,
    Sized,
    combined,
)

BUILD = {
    "drop": drop.lab, "pendulum": pendulum.lab, "slide": slide.lab, "roll": roll.lab, "double": double.lab
}  # fmt: skip
RIGS = tuple(BUILD)
KINDS = ("null", "single", "pair", "unlisted")
STRENGTHS = ("near", "moderate", "strong")
GAINS = {"near": (16.0, 40.0), "moderate": (80.0, 600.0), "strong": (600.0, math.inf)}
BENCHES = 8  # drawn at most until the effect shows as much as it should
CLOSE = 0.25  # of the gain that is wanted


@dataclass(frozen=True)
class Case:
    """What one lab is to hide."""

    kind: str
    rig: str
    effects: tuple[str, ...] = ()
    laws: tuple[str, ...] = ()
    strength: str = "null"


@dataclass(frozen=True)
class Drawn:
    """A lab, what it hides and how much that shows."""

    lab: Lab
    hidden: Hidden
    sizes: tuple[float, ...] = ()
    gain: float = 0.0
    strength: str = "null"


def plan(seed: int) -> Iterator[Case]:
    """Cases without end: every fourth a null, else all effects, the laws of each in turn, before any comes twice."""
    rng = np.random.default_rng((seed, 1))
    turn = {effect: int(rng.integers(100)) for effect in ALL}
    cases: Iterator[Case] = iter(())
    number = 0
    while True:
        number += 1
        if number % 4 == 0:
            yield Case("null", RIGS[number // 4 % len(RIGS)])
            continue
        if (case := next(cases, None)) is None:
            cases = iter(_round(rng, turn))
            case = next(cases)
        yield case


def _round(rng: Rng, turn: dict[str, int]) -> list[Case]:
    def law(name: str) -> str:
        turn[name] += 1
        laws = list(ALL[name].laws)
        return laws[turn[name] % len(laws)]

    cases = []
    for group, kind in ((LISTED, "single"), (UNLISTED, "unlisted")):
        for effect in group:
            for rig in effect.rigs:
                if rig in RIGS:
                    strength = str(rng.choice(STRENGTHS, p=(0.2, 0.4, 0.4)))
                    cases.append(Case(kind, rig, (effect.name,), (law(effect.name),), strength))
    for one, other, rig in PAIRS:
        strength = str(rng.choice(STRENGTHS[1:]))
        cases.append(Case("pair", rig, (one, other), (law(one), law(other)), strength))
    return [cases[k] for k in rng.permutation(len(cases))]


def draw(case: Case, rng: Rng) -> Drawn:
    """A lab that hides what the case asks for, as strong as it asks; another strength only if no bench would do."""
    setup: dict[str, Any] = {}
    for name in case.effects:
        setup |= {**ALL[name].setup, **ALL[name].on.get(case.rig, {})}
        if beads := ALL[name].beads.get(case.strength):
            setup["materials"] = beads
    if case.kind == "pair":
        setup.pop("wet", None)
    found: list[Drawn] = []
    for _ in range(BENCHES):
        lab = BUILD[case.rig](rng, **setup)
        if not case.effects:
            return Drawn(lab, Hidden())
        try:
            parts = [
                _sized(name, law, case.strength, lab, rng) for name, law in zip(case.effects, case.laws, strict=True)
            ]
        except ValueError:  # an arm that does not tilt far enough for so much friction, say
            continue
        hidden = combined([part.hidden for part in parts])
        least = min(parts, key=lambda part: part.gain)
        found.append(Drawn(lab, hidden, tuple(part.sizes[0] for part in parts), least.gain, least.strength))
        clear = case.strength in STRENGTHS[1:] and found[-1].strength in STRENGTHS[1:]
        if clear or found[-1].strength == case.strength:
            return found[-1]
    if not found:
        raise ValueError(f"{BENCHES} benches were drawn, and none can show {' and '.join(case.effects)}")
    return max(found, key=lambda one: one.gain)


def _sized(name: str, law: str, strength: str, lab: Lab, rng: Rng) -> Drawn:
    """One effect by one law, as strong as is wanted if its size is not nature's."""
    sized = ALL[name].laws[law](rng, lab)
    if ALL[name].absorbed:
        return Drawn(lab, sized(1.0), (1.0,), math.nan, strength)
    weigh = Strength(lab)
    size, gain = 1.0, weigh.gain(sized(1.0))
    low, high = GAINS[strength]
    if strength == "strong" and gain >= GAINS["moderate"][0]:
        low = gain  # as large as it is
    if not ALL[name].fixed and not low <= gain <= high:
        wanted = float(np.exp(rng.uniform(math.log(low), math.log(min(high, 6 * low)))))
        size, gain = _scaled(sized, weigh, gain, wanted)
    return Drawn(lab, sized(size), (size,), gain, strength_of(gain))


def _scaled(sized: Sized, weigh: Strength, gain: float, wanted: float) -> tuple[float, float]:
    """The size whose gain is the one wanted: gains grow about as the square of a size."""
    size = 1.0
    for _ in range(5):
        if abs(math.log(max(gain, 1e-6) / wanted)) < CLOSE:
            break
        size = min(size * math.sqrt(wanted / max(gain, 1e-6)), 3.0)
        gain = weigh.gain(sized(size))
    return size, gain


def strength_of(gain: float) -> str:
    """The class of a gain; what lies between the classes counts to the lower one."""
    return next((name for name in reversed(STRENGTHS) if gain >= GAINS[name][0]), "none")


def write(case: Case, name: str, seed: Sequence[int], folder: Path, *, most: int = 1000) -> dict[str, Any]:
    """One lab under `folder`/labs, of `most` conditions at most, its truth under `folder`/truth; returns the truth."""
    rng = np.random.default_rng(seed)
    drawn = draw(case, rng)
    lab, conditions = drawn.lab, drawn.lab.conditions[:most]
    place = folder / "labs" / name
    place.mkdir(parents=True, exist_ok=True)
    world: dict[tuple[str, str], float] = {}
    samples = 0
    for condition in conditions:
        (place / condition.stated["name"]).mkdir(exist_ok=True)
        for number in range(condition.repetitions):
            off = {chance.name: _deviation(chance, condition, world, rng) for chance in (*lab.chances, *CAMERA)}
            for key in [key for key in world if key[1] == "run"]:
                del world[key]
            tracked = film(lab.move(condition, off, drawn.hidden), lab, off, drawn.hidden, rng)
            samples += _write_track(place / condition.stated["name"] / f"rep{number + 1:02d}.csv", *tracked)
    (place / "lab.json").write_text(json.dumps(_stated(name, lab, conditions), indent=1) + "\n")
    truth = _truth(name, case, drawn, world) | {"samples": samples, "seed": list(seed)}
    (folder / "truth").mkdir(exist_ok=True)
    (folder / "truth" / f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n")
    return truth


def _deviation(chance: Chance, condition: Condition, world: dict[tuple[str, str], float], rng: Rng) -> float:
    """A deviation, drawn once for all runs that share it."""
    if chance.scope == "run":
        return float(chance.draw(rng))
    shared = {"lab": "lab", "condition": condition.stated["name"]}.get(chance.scope) or condition.groups[chance.scope]
    key = chance.name, shared
    if key not in world:
        world[key] = chance.draw(rng)
    return world[key]


def _write_track(file: Path, stamped: Array, tracked: Array) -> int:
    bodies = len(tracked) // 2
    lines = ["time_s,particle,x_m,y_m" if bodies > 1 else "time_s,x_m,y_m"]
    for k, time in enumerate(stamped):
        for body in range(bodies):
            who = f"{'AB'[body]}," if bodies > 1 else ""
            lines.append(f"{time:.5f},{who}{tracked[2 * body, k]:.6f},{tracked[2 * body + 1, k]:.6f}")
    file.write_text("\n".join(lines) + "\n")
    return len(lines) - 1


def _stated(name: str, lab: Lab, conditions: Sequence[Condition]) -> dict[str, Any]:
    """What the experimenter knows."""
    return {
        "case": name,
        "rig": lab.rig,
        "gravity_m_s2": GRAVITY,
        "camera": {
            "frame_rate_hz": lab.frame_rate,
            "frame_rate_uncertainty_rel": CLOCK_UNCERTAINTY,
            "scale_m_per_px": lab.scale,
            "scale_uncertainty_rel": SCALE_UNCERTAINTY,
            "roll_uncertainty_deg": ROLL_UNCERTAINTY,
            "tracking_noise_px": lab.noise,
            "tracked_point": "clump centre" if lab.rig == "slide" else "bead centre",
            "view": "perpendicular to the plane of motion",
        },
        "particles": {
            bead.name: {
                "diameter_m": bead.diameter,
                "diameter_uncertainty_m": DIAMETER_UNCERTAINTY,
                "density_kg_m3": bead.density,
                "mass_g": round(bead.mass * 1e3, 5),
                "youngs_modulus_Pa": bead.youngs_modulus,
                "poissons_ratio": bead.poissons_ratio,
                "material": bead.material,
            }
            for bead in lab.spheres
        },
        "conditions": [
            condition.stated
            | {"repetitions": condition.repetitions, "files": f"{condition.stated['name']}/rep%02d.csv"}
            for condition in conditions
        ],
        **({"walls": lab.walls} if lab.walls else {}),
        "coordinates": lab.coordinates,
        "rig_geometry": lab.geometry,
    }


def _truth(name: str, case: Case, drawn: Drawn, world: dict[tuple[str, str], float]) -> dict[str, Any]:
    effects = [ALL[effect] for effect in case.effects]
    return {
        "case": name,
        "rig": case.rig,
        "kind": case.kind,
        "verdict": {"null": "none", "unlisted": "unlisted"}.get(case.kind, "named"),
        "effects": list(case.effects),
        "laws": list(case.laws),
        "strength": drawn.strength,
        "gain": round(drawn.gain, 1) if math.isfinite(drawn.gain) else None,  # none where a plain model takes it up
        "sizes": [float(f"{size:.4g}") for size in drawn.sizes],
        "synonyms": {effect.name: [effect.name.replace("_", " "), *effect.synonyms] for effect in effects},
        "also_acceptable": {effect.name: list(effect.also) for effect in effects if effect.also},
        "unseen": any(effect.unseen for effect in effects),
        "absorbed": any(effect.absorbed for effect in effects),
        "parameters": {key: float(value) for key, value in drawn.hidden.shifts.items()},
        "where": {},
        "world": {f"{what}:{group}": value for (what, group), value in world.items()},
        "beads": [bead.name for bead in drawn.lab.spheres],
    }


def chosen(
    seed: int, count: int, *, kind: str | None = None, rig: str | None = None, effect: str | None = None
) -> Iterator[tuple[int, Case]]:
    """The first `count` cases of the plan that fit; the number of a case does not depend on the filters."""
    found = 0
    for number, case in enumerate(plan(seed)):
        if found == count or number > 100_000:
            return
        fits = kind in (None, case.kind) and rig in (None, case.rig) and (effect is None or effect in case.effects)
        if fits:
            found += 1
            yield number, case


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--rig", choices=RIGS)
    parser.add_argument("--effect", choices=sorted(ALL))
    given = parser.parse_args()
    for number, case in chosen(given.seed, given.count, kind=given.kind, rig=given.rig, effect=given.effect):
        name = f"i{given.seed}c{number:03d}"
        truth = write(case, name, (given.seed, number), given.out)
        hidden = " + ".join(f"{e} ({law})" for e, law in zip(case.effects, case.laws, strict=True)) or "nothing"
        sys.stdout.write(
            f"{name}  {case.rig:9} {hidden:45} {truth['strength']:9} gain {truth['gain']} "
            f"{truth['samples']:6d} samples\n"
        )


if __name__ == "__main__":
    main()
