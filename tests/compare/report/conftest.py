"""A comparison that nothing was measured or simulated for: its numbers are those that a test states."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rigtwin.compare.chosen import known_scatter
from rigtwin.compare.comparison import Comparison, Outcome
from rigtwin.compare.curve_overlays import Curve, Overlay
from rigtwin.compare.deviation import deviations
from rigtwin.compare.measure_repetitions import Failure
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.quantity import Check, Evaluation, Measurement, Quantity


@dataclass(frozen=True)
class Numbers:
    """What differs from lab to lab."""

    diameter_mm: float = 6.2
    mass_g: float = 0.071
    drop_mm: float = 264.0
    base_mm: float = 90.0
    rate_hz: float = 240.0
    scale_mm: float = 0.4177
    films: int = 3
    photos: int = 4
    wall_restitution: float = 0.42
    static: float = 0.36
    rolling: float = 0.06
    modulus_gpa: float = 11.0
    count: int = 1300
    seeds: tuple[int, ...] = (4, 5)
    step_us: float = 37.6
    law: str = "type C"
    scatter: str = ""


LAB = """
[lab]
title = "{title}"

[materials.ash]
density = "720 kg/m^3"
youngs_modulus = "{n.modulus_gpa} GPa"
poisson_ratio = 0.44

[particles.bead]
material = "ash"
diameter = "{n.diameter_mm} mm"
mass = "{n.mass_g} g"

[contacts.bead-steel]
restitution = {n.wall_restitution}
static_friction = {n.static}
rolling_friction = {n.rolling}

[contacts.bead-bead]
restitution = 0.75
static_friction = 0.44
rolling_friction = 0.08

[[experiments]]
id = "fall"
rig = "drop"
particle = "bead"
wall = "steel"
drop_height = "{n.drop_mm} mm"
repetitions = [{films}]
{n.scatter}

[experiments.camera]
frame_rate = "{n.rate_hz} Hz"

[[experiments]]
id = "heap"
rig = "pile"
variant = "piling"
particle = "bead"
wall = "steel"
base_diameter = "{n.base_mm} mm"
repetitions = [[{photos}]]
"""


def _measured(rig: str, source: Path, camera: dict[str, object], *quantities: Quantity) -> Measurement:
    checks = (Check("gravity", True, 9.81, 9.81, "free flight gives g = 9.81 m/s²."),)
    return Measurement(rig, source, "0" * 64, quantities, checks=checks, camera=camera)


def _twin(rig: str, settings: dict[str, object], numerics: dict[str, str], *quantities: Quantity) -> Twin:
    engine = {"device": "cpu", "threads": 2}
    whole = {"rig": {}, "engine": engine, "numerics": numerics, **settings}
    return Twin(
        rig, Evaluation(quantities), whole, assumptions=("contact law: Hertz-Mindlin", "outlet diameter: 22.5 mm")
    )


def _overlay(what: str) -> Overlay:
    x = np.linspace(-0.3, 0.4, 50)
    curves = [Curve(x, 40 * np.cos(3 * x) + shift) for shift in (0.0, 0.5, 2.0)]
    return Overlay(
        what, "time from the first contact / s", "height above the plate / mm", "mm", (*curves[:2],), (curves[2],), 6.2
    )


@pytest.fixture(scope="session")
def numbers() -> type[Numbers]:
    """`numbers(**others)`: those of a lab, with some that are others."""
    return Numbers


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Comparison]:
    """`comparison(numbers, title)`: films of drops and photos of a heap, with the twins of both."""

    def made(numbers: Numbers | None = None, title: str = "Ash on steel") -> Comparison:
        numbers, folder = numbers or Numbers(), tmp_path_factory.mktemp("lab")
        films = [f"r{k:02d}.mp4" for k in range(numbers.films + 1)]
        photos = [f"view{k}.jpg" for k in range(numbers.photos)]
        for name in (*films, *photos):
            (folder / name).touch()
        listed = {"films": ", ".join(f'"{one}"' for one in films), "photos": ", ".join(f'"{one}"' for one in photos)}
        (folder / "lab.toml").write_text(LAB.format(n=numbers, title=title, **listed), encoding="utf-8")
        lab = read_lab(folder)
        fall, heap = lab.experiments
        height = {
            "frame_rate_hz": numbers.rate_hz, "scale_m_per_px": numbers.scale_mm / 1e3, "scale_from": "known length",
        }  # fmt: skip
        drops = tuple(
            _measured(
                "drop", folder / name, height,
                Quantity("restitution_wall", 0.41 + k / 1e3, 0.004, "1", "height", {"bounce": 1}, {"scale": 0.004}),
            )
            for k, name in enumerate(films[:-1])
        )  # fmt: skip
        angle = Quantity(
            "angle_of_repose_geometric", 31.4, 1.2, "deg", "apex", {"side": "mean"}, {"grain roughness": 1.2}
        )
        seen = (_measured("pile", folder / photos[0], {"scale_m_per_px": 1.5e-4, "scale_from": "base"}, angle),)
        wall = {"restitution": numbers.wall_restitution, "static_friction": numbers.static,
                "rolling_friction": numbers.rolling}  # fmt: skip
        alone = _twin(
            "drop", {"contacts": {"bead-steel": wall}},
            {"contact_law": "Hertz-Mindlin", "stiffness_factor": "1 (the real Young's moduli)", "time_step": "halved"},
            Quantity("restitution_wall", numbers.wall_restitution, 1e-4, "1", "height", {"bounce": 1}),
        )  # fmt: skip
        heaps = tuple(
            _twin(
                "pile",
                {
                    "contacts": {"bead-steel": wall, "bead-bead": wall | {"restitution": 0.75}}, "seed": seed,
                    "placed": numbers.count, "asked": 9999, "statistics": {"time_step_s": 1e-6 * numbers.step_us},
                },
                {"contact_law": "Hertz-Mindlin", "stiffness_factor": "0.001 of the real Young's moduli",
                 "time_step": "30% of Rayleigh's", "rolling_resistance": f"{numbers.law}, torque limit mu_r Fn R"},
                Quantity("angle_of_repose_geometric", 26.0 + seed / 10, 1.0, "deg", "apex", {"side": "mean"}),
            )
            for seed in numbers.seeds
        )  # fmt: skip
        lost = (Failure(folder / films[-1], "no bead was found"),)
        outcomes = (
            _outcome(Outcome(fall, drops, lost, (alone,), (), (_overlay("height of the bead"),))),
            _outcome(Outcome(heap, seen, (), heaps, (), (_overlay("outline of the heap"),)), run_name="heap"),
        )
        return Comparison(lab, outcomes, numbers.seeds[0], datetime(2026, 2, 3, tzinfo=UTC))

    return made


def _outcome(outcome: Outcome, **more: str) -> Outcome:
    one = outcome.experiment
    rows = deviations(
        one.id, one.rig_name, outcome.measured.quantities,
        [quantity for twin in outcome.twins for quantity in twin.evaluation.quantities],
        scatter=partial(known_scatter, one), **more,
    )  # fmt: skip
    return Outcome(one, outcome.measurements, outcome.failures, outcome.twins, rows, outcome.shapes)
