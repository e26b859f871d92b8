"""Known parameters recovered from labs made by simulation.

    SEED=7 COUNT=4 python benchmarks/calibrate/recovery.py

A lab has a packed cylinder, a heap and a drum of 380 to 700 beads of one particle, written as tables of profiles.
Static and rolling friction between the beads are drawn from the priors of `rigtwin calibrate`, whose logarithms are
uniform.
The labs are made by our own engine, with other seeds than the calibration's.  Finished labs are kept in
``out/calibrate``, so that an interrupted benchmark continues.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.benchmarks.figures import OUT, SMOKE, Row, report, small
from rigtwin.compare.campaign.calibrate import RANGES, calibrate
from rigtwin.compare.campaign.sweep import stated_setting
from rigtwin.compare.campaign.vary import at
from rigtwin.compare.twins.matched import twin_of
from rigtwin.compare.twins.twin import write_twin

RIGS = {
    "packing": (["cylinder_diameter=50mm", "count=400"], 3),
    "pile": (["variant=piling", "base_diameter=80mm", "rim_height=10mm", "count=700"], 3),
    "drum": (["drum_diameter=100mm", "depth=30mm", "fill=0.35", "speed=6rpm"], 1),
}
"""Settings of each rig, and repetitions."""
SMALL = {"packing": (["cylinder_diameter=40mm", "count=120"], 2)}
WALL = "PMMA"
MEASURED_SEED = 9000  # first seed of the labs' own runs


def make_lab(folder: Path, truth: dict[str, float], seed: int) -> None:
    """Write a lab of simulated records."""
    folder.mkdir(parents=True, exist_ok=True)
    text = []
    for rig, (stated, repetitions) in small(RIGS, SMALL).items():
        setting = at(stated_setting(rig, stated, particle="D6", wall=WALL), truth)
        files = []
        for k in range(repetitions):
            twin = twin_of(setting.experiment, model=setting.model, seed=MEASURED_SEED + 10 * seed + k)
            written = write_twin(twin, folder / f"{rig}-{k}")
            record = written.get("surfaces") or written["record_1"]
            files.append(record.relative_to(folder).as_posix())
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


def one_lab(folder: Path, seed: int) -> dict[str, Any]:
    """Truth, intervals, runs and time [s] of a lab; read if it has finished before."""
    kept = folder / "result.json"
    if kept.is_file():
        return dict(json.loads(kept.read_text(encoding="utf-8")))
    random = np.random.default_rng(seed)
    truth = {name: float(low * (high / low) ** random.random()) for name, (low, high) in RANGES.items()}
    if not (folder / "lab" / "lab.toml").is_file():
        make_lab(folder / "lab", truth, seed)
    begun = time.perf_counter()
    found = calibrate(folder / "lab", folder / "calibration", seed=seed, budget=small(60, 20))
    result = {
        "truth": truth, "intervals": found.intervals, "best": dict(found.best), "runs": found.runs,
        "seconds": time.perf_counter() - begun, "stopped": found.stopped, "probability": found.misfit[1],
        "ambiguous": found.ambiguous,
    }  # fmt: skip
    kept.write_text(json.dumps(result, indent=2), encoding="utf-8")
    return result


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
    said = sum(one["probability"] >= 0.01 for one in found)
    share = float(100 * sum(held) / len(held))
    return report(
        "calibrate",
        [
            Row("true values in the 95 % intervals", share, "%", None, "90 to 98", None if SMOKE else share >= 90),
            Row("parameters", len(held)),
            Row("labs that fit", 100 * said / len(found), "%"),
            Row("most runs of a lab, confirmation included", runs, "1", None, "at most 60", bool(runs <= 60)),
            Row("longest calibration", seconds / 60, "min", None, "at most 20", bool(seconds <= 1200)),
        ],
    )


if __name__ == "__main__":
    sys.exit(main())
