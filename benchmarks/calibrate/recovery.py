"""Known parameters recovered from labs made by simulation.

    SEED=7 COUNT=4 python benchmarks/calibrate/recovery.py

A lab has a packed cylinder, a heap and a drum of 380 to 700 beads of one particle, written as tables of profiles.
Two to four parameters are unknown: static and rolling friction between the beads, in every second lab the size of the
beads, in every fourth their friction on the wall, too.  Their true values are drawn from the priors.  Half of the labs
are made by our own engine, with other seeds than the calibration's, half by LIGGGHTS from exported decks (rolling
friction of type C), where it is installed.  Finished labs are kept in ``out/calibrate``, so that an interrupted
benchmark continues; delete the folder to measure anew.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.benchmarks.engine.decks import BINARY, computed
from rigtwin.benchmarks.figures import OUT, SMOKE, Row, report, small
from rigtwin.compare.campaign.calibrate import RANGES, calibrate
from rigtwin.compare.campaign.posterior import Parameter
from rigtwin.compare.campaign.sweep import stated_setting
from rigtwin.compare.campaign.vary import Setting, at
from rigtwin.compare.twins.matched import twin_of
from rigtwin.compare.twins.twin import Twin, write_twin
from rigtwin.sim.decks.deck import Deck

RIGS = {
    "packing": (["cylinder_diameter=50mm", "count=400"], 3),
    "pile": (["variant=piling", "base_diameter=80mm", "rim_height=10mm", "outlet_height=50mm", "count=700"], 3),
    "drum": (["drum_diameter=100mm", "depth=30mm", "fill=0.35", "speed=6rpm"], 1),
}
"""Settings of each rig, and repetitions."""
SMALL = {"packing": (["cylinder_diameter=40mm", "count=120"], 2)}
WALL = "PMMA"
MEASURED_SEED = 9000  # first seed of the labs' own runs
MORE = {"scale": (0.95, 1.05), "wall_static_friction": (0.05, 0.8)}
"""Ranges of further unknown parameters."""


def unknown(number: int) -> list[Parameter]:
    """The unknown parameters of a lab."""
    more = ["scale"] * (number % 4 >= 2) + ["wall_static_friction"] * (number % 8 >= 6)
    return [Parameter(name, *(RANGES | MORE)[name]) for name in (*RANGES, *more)]


def code_of(number: int) -> str:
    """The code that makes a lab."""
    return "liggghts" if number % 2 and shutil.which(BINARY["liggghts"]) else "rigtwin"


def made(code: str, setting: Setting, seed: int) -> Twin:
    """The run of a rig that our own engine, or LIGGGHTS, computes."""
    experiment, model = setting
    if code == "rigtwin":
        return twin_of(experiment, model=model, seed=seed)
    bead, wall = experiment.particle, experiment.wall
    assert wall is not None
    contacts = (model.contact(bead.name, bead.name), model.contact(bead.name, wall.name))
    rig, count = experiment.rig.rig(), getattr(experiment.rig, "count", None)
    deck = Deck("liggghts", rig, bead, wall, *contacts, count=count, seed=seed)  # type: ignore[arg-type]
    return computed(deck, 1)[0]


def make_lab(folder: Path, truth: dict[str, float], seed: int, code: str) -> None:
    """Write a lab of simulated records."""
    folder.mkdir(parents=True, exist_ok=True)
    text = []
    for rig, (stated, repetitions) in small(RIGS, SMALL).items():
        setting = at(stated_setting(rig, stated, particle="D6", wall=WALL), truth)
        files = []
        for k in range(repetitions):
            twin = made(code, setting, MEASURED_SEED + 10 * seed + k)
            written = write_twin(twin, folder / f"{rig}-{k}")
            views = [path for name, path in written.items() if name.startswith("record_")]
            records = [written["surfaces"]] if "surfaces" in written else views
            files.append([path.relative_to(folder).as_posix() for path in records])
        text += [
            "[[experiments]]", f'id = "{rig}"', f'rig = "{rig}"', 'particle = "D6"', f'wall = "{WALL}"',
            *(f"{key} = {value}" for key, value in split(stated)),
            f"repetitions = {json.dumps(files)}", "",
        ]  # fmt: skip
    (folder / "lab.toml").write_text("\n".join(text), encoding="utf-8")


def split(stated: list[str]) -> list[tuple[str, str]]:
    """Keys of settings, and their values as TOML."""
    parts = [one.partition("=") for one in stated]
    return [(key, value if value.replace(".", "").isdecimal() else json.dumps(value)) for key, _, value in parts]


def one_lab(folder: Path, number: int) -> dict[str, Any]:
    """Truth, intervals, runs and time [s] of a lab; read if it has finished before."""
    kept = folder / "result.json"
    if kept.is_file():
        return dict(json.loads(kept.read_text(encoding="utf-8")))
    code, parameters = prepared(folder, number)
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    begun = time.perf_counter()
    fit = [f"{one.name}={one.low}..{one.high}" for one in parameters]
    found = calibrate(folder / "lab", folder / "calibration", fit=fit, seed=number, budget=small(60, 20))
    result = {
        "made_by": code, "truth": truth, "intervals": found.intervals, "best": dict(found.best), "runs": found.runs,
        "seconds": time.perf_counter() - begun, "stopped": found.stopped, "fits": found.fits,
        "ambiguous": found.ambiguous,
    }  # fmt: skip
    kept.write_text(json.dumps(result, indent=2), encoding="utf-8")
    return result


def prepared(folder: Path, number: int) -> tuple[str, list[Parameter]]:
    """Make a lab that is not there yet; the code that made it, and its unknown parameters."""
    random = np.random.default_rng(number)
    code, parameters = code_of(number), unknown(number)
    if not (folder / "truth.json").is_file():
        truth = {one.name: float(one.value(np.array(random.random()))) for one in parameters}
        make_lab(folder / "lab", truth, number, code)
        (folder / "truth.json").write_text(json.dumps(truth), encoding="utf-8")
    return code, parameters


def main() -> int:
    seed, count = int(os.environ.get("SEED", "1")), int(os.environ.get("COUNT", small("12", "1")))
    found = []
    for k in range(count):
        found.append(one_lab(OUT / "calibrate" / f"lab-{seed + k}", seed + k))
        print(json.dumps(found[-1]["truth"]), json.dumps(found[-1]["intervals"]), flush=True)  # noqa: T201
    held = [
        one["intervals"][name]["low"] <= value <= one["intervals"][name]["high"]
        for one in found
        for name, value in one["truth"].items()
    ]
    runs, seconds = max(one["runs"] for one in found), max(one["seconds"] for one in found)
    fits = sum(one["fits"] for one in found)
    widths = [
        float(np.subtract(*one.unit(np.array([interval["high"], interval["low"]]))))
        for k, result in enumerate(found)
        for one in unknown(seed + k)
        if (interval := result["intervals"][one.name])
    ]
    share = float(100 * sum(held) / len(held))
    return report(
        "calibrate",
        [
            Row(
                "true values in the 95 % intervals", share, "%", None, "90 to 98", None if SMOKE else 90 <= share <= 98
            ),
            Row("parameters", len(held)),
            Row("width of an interval over its range, median", 100 * float(np.median(widths)), "%"),
            Row("labs that fit", 100 * fits / len(found), "%"),
            Row("most runs of a lab, those of the best set included", runs, note="60 are allowed"),
            Row("longest calibration", seconds / 60, "min", None, "at most 20", bool(seconds <= 1200)),
        ],
    )


if __name__ == "__main__":
    sys.exit(main())
