"""Memory, open files and threads of one process that measures a thousand media and runs two hundred twins.

    python benchmarks/soak.py        # COUNT= measurements, a fifth as many twins

The media of all seven rigs are measured in turn, with overlays and results written; then twins of five rigs run in
turn.  Both grow while the first of each kind are loaded; wanted is that nothing grows after the first third.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import rigtwin
from rigtwin.benchmarks.engine.flows import memory
from rigtwin.benchmarks.figures import Row, below, report, small

COUNT = int(os.environ.get("COUNT", small(1000, 2)))
MEDIA = Path(__file__).resolve().parent.parent / "sample_media"
SEVEN = MEDIA / "seven_rigs"
BEAD: dict[str, Any] = {"bead_diameter": "6.2 mm"}
MEASURED: list[tuple[Any, list[Path], dict[str, Any]]] = [
    ("drop", [MEDIA / "drop" / "r01.mp4"], {**BEAD, "frame_rate": "240 Hz"}),
    ("pile", [MEDIA / "pile" / "view1.jpg", MEDIA / "pile" / "view2.jpg"], {**BEAD, "base_diameter": "90 mm"}),
    ("packing", [SEVEN / "packing.jpg"], {**BEAD, "cylinder_diameter": "50 mm"}),
    ("tilt", [SEVEN / "tilt.mp4"], {**BEAD, "variant": "slide", "frame_rate": "100 Hz", "scale": "0.5 mm/px"}),
    ("drum", [SEVEN / "drum.mp4"], {**BEAD, "drum_diameter": "100 mm", "speed": "6 rpm", "frame_rate": "30 Hz"}),
    ("hopper", [SEVEN / "hopper.mp4"], {**BEAD, "bin_width": "60 mm", "frame_rate": "120 Hz"}),
    (
        "pendulum",
        [MEDIA / "pendulum" / "r01.mp4"],
        {"variant": "double", "length": "190 mm", "bead_diameter": "12.2 mm", "frame_rate": "240 Hz"},
    ),
]
TWINS: list[tuple[Any, dict[str, Any]]] = [
    ("drop", {"drop_height": "100 mm"}),
    ("packing", {"count": 100, "seed": 1}),
    ("pile", {"count": 60, "base_diameter": "60 mm", "seed": 1}),
    ("hopper", {"count": 100, "seed": 1, "variant": "slot", "bin_width": "60 mm", "depth": "40 mm", "outlet": "25 mm"}),
    ("pendulum", {"variant": "double", "length": "190 mm", "release_angle": "45 deg"}),
]
GROWTH = 0.02  # [MB] a measurement or twin, above which 1000 of them cost as much as one more film of a few seconds


def soak(name: str, count: int, one: Callable[[int], object]) -> list[Row]:
    """Rows on what the process holds from a third of the runs on."""
    held, files, threads = [], [], []
    for number in range(count):
        one(number)
        held.append(memory()[0] / 1000)
        files.append(len(list(Path("/proc/self/fd").iterdir())))
        threads.append(threading.active_count())
        if sys.stderr.isatty():
            print(f"\r{name} {number + 1} of {count}, {held[-1]:.0f} MB", end="", file=sys.stderr)  # noqa: T201
    settled = slice(count // 3, None)
    slope = float(np.polyfit(np.arange(count)[settled], held[settled], 1)[0]) if count > 6 else 0.0
    note = f"{held[0]:.0f} MB after the first, {held[settled][0]:.0f} after a third, {held[-1]:.0f} at the end"
    return [
        below(
            f"{name}: memory that each adds", max(slope, 0.0), GROWTH, unit="MB", note=f"{count} in one process; {note}"
        ),
        below(f"{name}: open files added", max(files[settled]) - files[settled][0], 1),
        below(f"{name}: threads added", max(threads[settled]) - threads[settled][0], 1),
    ]


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:

        def measured(number: int) -> object:
            rig, media, settings = MEASURED[number % len(MEASURED)]
            return rigtwin.measure(rig, *media, out=Path(folder) / rig, **settings)

        def simulated(number: int) -> object:
            rig, settings = TWINS[number % len(TWINS)]
            return rigtwin.simulate(rig, **settings)

        rows = soak("measurements", COUNT, measured)
        rows += soak("twins", max(COUNT // 5, 5), simulated)
    return report("soak", rows)


if __name__ == "__main__":
    sys.exit(main())
