"""lab.toml, lab.json and model.toml."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

from rigtwin.benchmarks.fuzz_cases.case import NOT_RUN, Case, out, written
from rigtwin.benchmarks.fuzz_cases.mutations import in_words
from rigtwin.benchmarks.fuzz_cases.reference import same_model, same_results, same_settings
from rigtwin.benchmarks.fuzz_cases.tables import table

TO_THE_END = 0.2  # share of diagnoses that are fitted, which takes seconds; the others end when the lab is read

LAB = """[lab]
title = "Bench"
[materials.ash]
density = "720 kg/m^3"
youngs_modulus = "11 GPa"
poisson_ratio = 0.44
[particles.bead]
material = "ash"
diameter = "6 mm"
density = "568 kg/m^3"
[contacts.bead-steel]
restitution = 0.42
static_friction = 0.36
rolling_friction = 0.06
[contacts.bead-bead]
restitution = 0.5
static_friction = 0.4
rolling_friction = 0.05
[[experiments]]
id = "drop"
rig = "drop"
particle = "bead"
wall = "steel"
drop_height = "200 mm"
"""
FILMED = """repetitions = ["r01.csv"]
[experiments.camera]
frame_rate = "240 Hz"
"""
STATED = """[experiments.measured]
restitution_wall = [
  {value = "0.584 +- 0.02 (n = 5)", method = "height"},
  {value = "0.59, 0.58, 0.6", method = "time"},
]
"""
MORE = """[[experiments]]
id = "heap"
rig = "pile"
variant = "piling"
particle = "D6"
wall = "steel"
base_diameter = "90 mm"
count = 60
[experiments.measured]
angle_of_repose_graphical = {value = "24 +- 1 deg (n = 3)", method = "line 15-85 %"}
[experiments.scatter]
angle_of_repose_graphical = "4 %"
[[experiments]]
id = "bed"
rig = "packing"
particle = "D6"
wall = "PMMA"
cylinder_diameter = "65 mm"
total_mass = "212.7 g"
[experiments.measured]
bed_height = "184 +- 1.3 mm (n = 10)"
[[experiments]]
id = "flow"
rig = "hopper"
variant = "slot"
particle = "D6"
wall = "PMMA"
outlet = "34 mm"
bin_width = "104 mm"
depth = "40 mm"
[experiments.measured]
discharge_time = "2.1 +- 0.1 s (n = 4)"
[[experiments]]
id = "swing"
rig = "pendulum"
variant = "double"
particle = "bead"
length = "300 mm"
release_angle = "40 deg"
[experiments.measured]
energy_ratio_root = "0.6 +- 0.1 (n = 2)"
[[experiments]]
id = "turn"
rig = "drum"
particle = "D6"
wall = "PMMA"
drum_diameter = "140 mm"
speed = "3 rpm"
[experiments.measured]
angle_of_repose_upper = "30 +- 2 deg (n = 3)"
"""
MODEL = """[materials.ash]
density = 720
youngs_modulus = 11e9
poisson_ratio = 0.44
[contacts.D6-steel]
restitution = 0.42
[effects.air_drag]
drag_coefficient = 0.47
"""


def notes(repetitions: int = 6) -> str:
    """A lab.json of tracked drops."""
    condition = {"name": "one", "wall": "steel", "particle": "D6", "repetitions": repetitions, "files": "r%02d.csv"}
    bead = {"diameter_m": 0.006, "mass_g": 0.064}
    camera = {"frame_rate_hz": 240, "scale_m_per_px": 2e-4, "tracking_noise_px": 0.2}
    conditions = [{**condition, "drop_height_m": 0.05}]
    return json.dumps({"rig": "drop", "camera": camera, "particles": {"D6": bead}, "conditions": conditions})


def measured_lab(chance: Random, folder: Path) -> Case:
    """A lab.toml with a table as its repetition."""
    written(folder, "r01.csv", table())
    written(folder, "lab.toml", in_words(chance, LAB + FILMED))
    return Case(["measure", str(folder), "--workers", "1", *out(folder)])


def stated_lab(chance: Random, folder: Path) -> Case:
    """A lab.toml of all rigs whose results are stated."""
    path = Path(written(folder, "lab.toml", in_words(chance, LAB + STATED + MORE)))
    return Case(["measure", str(folder), *out(folder)], lambda document: same_results(path, document))


def simulated_lab(chance: Random, folder: Path) -> Case:
    """A lab.toml whose particle falls in a twin; the numbers that the twin used are read again by other means."""
    path = folder / "lab.toml"
    written(folder, path.name, in_words(chance, LAB + STATED))
    command = ["simulate", "drop", "--lab", str(folder), "--particle", "bead", "--drop-height", "50mm"]
    return Case([*command, "--bounces", "2", *out(folder)], lambda document: same_settings(path, document))


def compared_lab(chance: Random, folder: Path) -> Case:
    """A lab.toml that is compared with its twin, which writes the report."""
    written(folder, "lab.toml", in_words(chance, LAB + STATED))
    return Case(["compare", str(folder), *out(folder)])


def model(chance: Random, folder: Path) -> Case:
    """A model.toml on which a lab is compared."""
    written(folder, "lab.toml", LAB.replace('"bead"', '"D6"') + STATED)
    path = Path(written(folder, "model.toml", in_words(chance, MODEL)))
    return Case(["compare", str(folder), "--model", str(path), *out(folder)], lambda _: same_model(path))


def tracked_lab(chance: Random, folder: Path) -> Case:
    """A lab.json that is diagnosed."""
    for k in range(1, 6):
        written(folder, f"r0{k}.csv", table(1e-4 * k))
    whole = chance.random() < TO_THE_END
    written(folder, "lab.json", in_words(chance, notes(5)))
    return Case(["diagnose", str(folder), "--workers", "1", *out(folder)] + ([] if whole else ["--seed", "0"]))


@contextmanager
def read_only(command: list[str]) -> Iterator[None]:
    """Let a diagnosis with ``--seed 0`` end where its lab is read."""
    if command[0] != "diagnose" or command[-2:] != ["--seed", "0"]:
        yield
        return
    from rigtwin.compare.diagnose import diagnose_folder
    from rigtwin.lab.errors import BadInput

    def read(*_: Any) -> Any:
        raise BadInput(NOT_RUN)

    fitted = diagnose_folder.diagnose, diagnose_folder.diagnose_bulk
    diagnose_folder.diagnose = diagnose_folder.diagnose_bulk = read
    try:
        yield
    finally:
        diagnose_folder.diagnose, diagnose_folder.diagnose_bulk = fitted
