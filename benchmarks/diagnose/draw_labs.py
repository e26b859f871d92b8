"""Labs with a hidden effect, drawn by seed: what a careful lab would hand over, and the sealed truth beside it.

    python benchmarks/diagnose/draw_labs.py --seed 7 --count 30 --out DIR [--kind null] [--rig drop] [--effect air_drag]

writes DIR/labs/CASE/lab.json with DIR/labs/CASE/CONDITION/repNN.csv, and DIR/truth/CASE.json.  A third of the labs hide
nothing; the rest hide one effect, two, or one that no list has.  The physics is `labs_motion`, not rigtwin's simulator.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rigtwin.benchmarks.diagnose.lab_camera import Camera, film, ordinary
from rigtwin.benchmarks.diagnose.lab_effects import ALL, CONFOUNDED, LISTED, PAIRS, STRENGTHS, UNLISTED, Effect
from rigtwin.benchmarks.diagnose.lab_motion import GRAVITY, World
from rigtwin.benchmarks.diagnose.lab_rigs import DIAMETER_UNCERTAINTY, Bench, Change, Run, plate, set_up
from rigtwin.benchmarks.figures import small

REPETITIONS = small(10, 6)  # of the one condition of a narrowed lab
KINDS = ("null", "single", "pair", "unlisted")
EVERY_RIG = ("drop", "drop", "pendulum", "pendulum", "wall pendulum", "double", "slide", "roll")  # of the nulls


@dataclass(frozen=True)
class Case:
    """What one lab is to hide."""

    kind: str
    rig: str
    effects: tuple[str, ...] = ()
    strength: str = "null"


def plan(seed: int) -> Iterator[Case]:
    """Cases without end: every third a null; the others go through all effects and strengths before any comes twice."""
    rng = np.random.default_rng(seed)
    nulls, singles = iter(()), iter(())
    number = 0
    while True:
        number += 1
        if number % 3 == 0:
            if (null := next(nulls, None)) is None:
                nulls = iter([Case("null", str(rig)) for rig in rng.permutation(EVERY_RIG)])
                null = next(nulls)
            yield null
            continue
        if (case := next(singles, None)) is None:
            singles = iter(_round(rng))
            case = next(singles)
        yield case


def confounded(seed: int) -> Iterator[Case]:
    """Cases without end that a lab of one condition often cannot tell from others."""
    rng = np.random.default_rng(seed)
    while True:
        for effect, rig in CONFOUNDED:
            yield Case("single", rig, (effect,), str(rng.choice(STRENGTHS)))


def _round(rng: np.random.Generator) -> list[Case]:
    cases = []
    for group, kind in ((LISTED, "single"), (UNLISTED, "unlisted")):
        for effect in group:
            for strength in STRENGTHS:
                rig = str(rng.choice(list(effect.sizes)))
                if effect.wall_only and rig == "pendulum":
                    rig = "wall pendulum"
                cases.append(Case(kind, rig, (effect.name,), strength))
    for one, other, rig in PAIRS:
        cases.append(Case("pair", rig, (one, other), str(rng.choice(["moderate", "strong"]))))
    return [cases[k] for k in rng.permutation(len(cases))]


def draw(case: Case, rng: np.random.Generator) -> tuple[Bench, Camera, World, dict[str, float]]:
    """A bench, a camera and a world that hides what the case asks for; the hidden numbers by their names."""
    rig = case.rig.removeprefix("wall ")
    world, wanted, parameters = World(), (), {}
    for name in case.effects:
        effect = ALL[name]
        size = effect.sizes[rig][STRENGTHS.index(case.strength)] * float(rng.uniform(0.85, 1.15))
        if effect.signed and rng.random() < 0.5:
            size = -size
        number = effect.number
        if name == "air_drag" and rng.random() < 0.5:
            number, size = "c_D", float(rng.uniform(0.9, 1.1))  # the same air by the law of Schiller and Naumann
        if name == "buoyancy":
            size = 1.2
        if number == "cam_q":
            size += 1
        parameters[number] = size
        world.hidden |= {number: size, **effect.more}
        wanted = wanted or effect.beads.get(case.strength, ())
    bench = set_up(rig, world, rng, wanted=wanted, wall=case.rig.startswith("wall"))
    camera = ordinary(rng, frame_rate=bench.frame_rate, scale=bench.scale)
    return bench, camera, world, parameters


def narrow(bench: Bench) -> Bench:
    """One condition in some repetitions is all there is, as in a lab that has only just begun."""
    return replace(bench, runs=(replace(bench.runs[len(bench.runs) // len(bench.beads) - 1], repetitions=REPETITIONS),))


def write(
    case: Case, name: str, seed: Sequence[int], folder: FilePath, *, narrowed: bool = False,
    design: Mapping[str, Any] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """One lab under `folder`/labs and its truth under `folder`/truth; returns the truth.

    With a `design` of a diagnosis of it, that experiment is carried out too: the same world, the same camera.
    """
    rng = np.random.default_rng(seed)
    bench, camera, world, parameters = draw(case, rng)
    bench = narrow(bench) if narrowed else bench
    lab = folder / "labs" / name
    lab.mkdir(parents=True, exist_ok=True)
    samples = sum(_write_run(run, lab, camera, world, rng) for run in bench.runs)
    if design is not None:
        further = _further(bench, design)
        samples += _write_run(further, lab, camera, world, rng)
        new = () if further.bead in bench.beads else (further.bead,)
        bench = replace(bench, runs=(*bench.runs, further), beads=(*bench.beads, *new))
        if (wall := further.stated.get("wall")) not in (None, *bench.walls):
            bench = replace(bench, walls=(*bench.walls, wall))
    (lab / "lab.json").write_text(json.dumps(_stated(name, bench, camera), indent=1) + "\n")
    truth = _truth(name, case, bench, camera, world, parameters) | {"samples": samples, "seed": list(seed)}
    (folder / "truth").mkdir(exist_ok=True)
    (folder / "truth" / f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n")
    return truth


def _write_run(run: Run, lab: FilePath, camera: Camera, world: World, rng: np.random.Generator) -> int:
    place = lab / run.stated["name"]
    place.mkdir(exist_ok=True)
    samples = 0
    for k in range(run.repetitions):
        path = run.move(rng)
        stamped, bodies, kept = film(path, camera, world.hidden, rng)
        samples += _write_track(place / f"rep{k + 1:02d}.csv", stamped, bodies, kept)
    return samples


def _further(bench: Bench, design: Mapping[str, Any]) -> Run:
    """The condition that a diagnosis proposed, of which one thing differs from a condition of this bench."""
    like = next(run for run in bench.runs if run.stated["name"] == design["condition"])
    change, bead = design["change"], like.bead
    if change["density"] != 1.0 or change["size"] != 1.0:
        density = bead.density * change["density"]
        material = bead.material
        if change["density"] != 1.0:
            material = "steel" if density > 5000 else "expanded polystyrene"
        diameter = bead.diameter * change["size"]
        bead = replace(bead, name=f"{bead.name}_other", density=density, diameter=diameter, material=material)
    run = like.again(bead, Change(change["release"], change["state"], change["longer"], change.get("thickness", 1.0)))
    return replace(run, repetitions=design.get("repetitions", run.repetitions))


def _write_track(file: FilePath, stamped: Any, bodies: Sequence[Any], kept: Any) -> int:
    several = len(bodies) > 1
    lines = ["time_s,particle,x_m,y_m" if several else "time_s,x_m,y_m"]
    for k in np.flatnonzero(kept):
        for label, body in zip("AB", bodies, strict=False):
            who = f"{label}," if several else ""
            lines.append(f"{stamped[k]:.5f},{who}{body[0, k]:.6f},{body[1, k]:.6f}")
    file.write_text("\n".join(lines) + "\n")
    return len(lines) - 1


def _stated(name: str, bench: Bench, camera: Camera) -> dict[str, Any]:
    """What the experimenter knows."""
    return {
        "case": name,
        "rig": bench.rig,
        "gravity_m_s2": GRAVITY,
        "camera": {
            "frame_rate_hz": camera.frame_rate,
            "frame_rate_uncertainty_rel": 0.0001,
            "scale_m_per_px": camera.scale,
            "scale_uncertainty_rel": 0.002,
            "roll_uncertainty_deg": 0.15,
            "tracking_noise_px": camera.noise,
            "tracked_point": "clump centre" if bench.rig == "slide" else "bead centre",
            "view": "perpendicular to the plane of motion",
        },
        "particles": {
            bead.name: {
                "diameter_m": bead.diameter,
                "diameter_uncertainty_m": DIAMETER_UNCERTAINTY,
                "density_kg_m3": bead.density,
                "mass_g": round(bead.mass * 1e3, 5),
                "youngs_modulus_Pa": bead.youngs_modulus,
                "poissons_ratio": bead.poisson_ratio,
                "material": bead.material,
            }
            for bead in bench.beads
        },
        "conditions": [
            run.stated | {"repetitions": run.repetitions, "files": f"{run.stated['name']}/rep%02d.csv"}
            for run in bench.runs
        ],
        **({"walls": {wall: _wall(wall) for wall in bench.walls}} if bench.walls else {}),
        "coordinates": bench.coordinates,
        "rig_geometry": bench.geometry,
    }


def _wall(name: str) -> dict[str, float]:
    made = plate(name)
    return {
        "density_kg_m3": made.density, "youngs_modulus_Pa": made.youngs_modulus, "poissons_ratio": made.poisson_ratio,
        "thickness_m": made.thickness,
    }  # fmt: skip


def _truth(
    name: str, case: Case, bench: Bench, camera: Camera, world: World, parameters: dict[str, float]
) -> dict[str, Any]:
    effects: list[Effect] = [ALL[effect] for effect in case.effects]
    verdict = {"null": "none", "unlisted": "unlisted"}.get(case.kind, "named")
    return {
        "case": name,
        "rig": case.rig,
        "kind": case.kind,
        "verdict": verdict,
        "effects": list(case.effects),
        "strength": case.strength,
        "synonyms": {effect.name: [effect.name.replace("_", " "), *effect.synonyms] for effect in effects},
        "also_acceptable": {effect.name: list(effect.also) for effect in effects if effect.also},
        "unseen": any(effect.unseen for effect in effects),
        "parameters": parameters,
        "where": {effect.name: effect.where for effect in effects},
        "world": {
            "cam_s": (1 + camera.scale_error) * (1 + world.hidden.get("scale", 0.0)),
            "cam_q": (1 + camera.clock_error) * world.hidden.get("cam_q", 1.0),
            "cam_roll": camera.roll + world.hidden.get("roll", 0.0),
            "level_deg": math.degrees(world.level),
            "locking_px": camera.locking,
            "drift_px": camera.drift,
            "restitution_scatter": world.restitution_scatter,
            "kick_scatter": world.kick_scatter,
            "friction_scatter": world.friction_scatter,
            **{f"e:{pair}": e for pair, e in world.restitution.items()},
            **{f"mu:{wall}": mu for wall, mu in world.sliding.items()},
            **{f"mur:{pair}": mu for pair, mu in world.rolling.items()},
            **world.hidden,
        },
        "beads": [bead.name for bead in bench.beads],
    }


def chosen(
    seed: int, count: int, *, kind: str | None = None, rig: str | None = None, effect: str | None = None,
    strength: str | None = None, cases: Callable[[int], Iterator[Case]] = plan,
) -> Iterator[tuple[int, Case]]:  # fmt: skip
    """The first `count` cases of the plan that fit; the number of a case does not depend on the filters."""
    found = 0
    for number, case in enumerate(cases(seed)):
        if found == count or number > 100_000:
            return
        fits = (
            (kind is None or case.kind == kind)
            and (rig is None or case.rig == rig)
            and (effect is None or effect in case.effects)
            and (strength is None or case.strength == strength)
        )
        if fits:
            found += 1
            yield number, case


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--out", type=FilePath, required=True)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--rig", choices=sorted(set(EVERY_RIG)))
    parser.add_argument("--effect", choices=sorted(ALL))
    parser.add_argument("--strength", choices=(*STRENGTHS, "null"))
    given = parser.parse_args()
    filters = {"kind": given.kind, "rig": given.rig, "effect": given.effect, "strength": given.strength}
    for number, case in chosen(given.seed, given.count, **filters):
        name = f"s{given.seed}c{number:03d}"
        truth = write(case, name, (given.seed, number), given.out)
        print(f"{name}  {case.rig:13} {truth['samples']:6d} samples")  # noqa: T201


if __name__ == "__main__":
    main()
