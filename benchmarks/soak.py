"""Memory, open files and threads of one process that measures a thousand media and runs two hundred twins.

    python benchmarks/soak.py        # COUNT= measurements, a fifth as many twins

The media of all seven rigs are measured in turn, results and overlays written; then twins of five rigs run in turn.
Memory grows until each has been loaded; after the first third it must not.  Ctrl-C ends a part early.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import rigtwin
from rigtwin.benchmarks.engine.flows import memory
from rigtwin.benchmarks.figures import Row, below, report, skipped, small

COUNT = int(os.environ.get("COUNT", small(1000, 7)))
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
GROWTH = 0.02  # [MB] a run, above which 1000 of them cost as much as one more film of a few seconds
FEWEST = 5  # turns, from which a slope and its uncertainty follow
SURE = 2.0  # standard uncertainties


def threads() -> int:
    """Threads of this process, those of libraries included."""
    return len(list(Path("/proc/self/task").iterdir()))


def files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def soak(name: str, kinds: Sequence[str], count: int, one: Callable[[int], object]) -> Iterator[Row]:
    """Rows on what the process holds from a third of the runs on; the runs are of the `kinds` in turn."""
    held = np.empty((0, 3))
    with suppress(KeyboardInterrupt):
        for number in range(count):
            one(number)
            held = np.vstack([held, (memory()[0] / 1000, files(), threads())])
            if number % 50 == 49:
                print(f"{name}: {number + 1} of {count}, {held[-1, 0]:.0f} MB", file=sys.stderr, flush=True)  # noqa: T201
    if not len(held):
        return
    # whole turns, so that each kind weighs the same
    turns = held[: len(held) // len(kinds) * len(kinds)].reshape(-1, len(kinds), 3)
    settled = turns[max(len(turns) // 3, 1) :]
    note = f"{len(held)} runs in one process; {held[0, 0]:.0f} MB after the first, {held[-1, 0]:.0f} MB at the end"
    if len(settled) < FEWEST:
        yield skipped(f"{name}: memory that each adds", f"fewer than {FEWEST} settled turns; {note}")
        return
    each = settled[..., 0].mean(axis=1)  # [MB], of every turn
    (slope, _), covariance = np.polyfit(np.arange(len(each)), each, 1, cov=True)
    growth, unsure = slope / len(kinds), math.sqrt(covariance[0, 0]) / len(kinds)
    wanted = f"below {GROWTH:g}"
    passed = bool(growth + SURE * unsure < GROWTH)
    yield Row(f"{name}: memory that each adds", growth, "MB", None, wanted, passed, f"± {unsure:.2g}; {note}")
    steps = np.diff(np.concatenate([[turns[len(turns) - len(settled) - 1, -1, 0]], settled[..., 0].ravel()]))
    for kind, added in zip(kinds, steps.reshape(-1, len(kinds)).T, strict=True):
        yield Row(f"{name}, {kind}: memory kept", float(added.mean()), "MB", note="the next run may give it back")
    for what, column in (("open files", 1), ("threads", 2)):
        yield below(f"{name}: {what} added", float(settled[..., column].max() - settled[0, :, column].max()), 1)


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:

        def measured(number: int) -> object:
            rig, media, settings = MEASURED[number % len(MEASURED)]
            return rigtwin.measure(rig, *media, out=Path(folder) / rig, **settings)

        def simulated(number: int) -> object:
            rig, settings = TWINS[number % len(TWINS)]
            return rigtwin.simulate(rig, **settings)

        rows = [*soak("measurements", [rig for rig, _, _ in MEASURED], COUNT, measured)]
        rows += soak("twins", [rig for rig, _ in TWINS], max(COUNT // 5, len(TWINS)), simulated)
    return report("soak", rows)


if __name__ == "__main__":
    sys.exit(main())
