"""Speed of the bulk engine on a GPU beside the CPU of the same machine: particle-steps per second of a settled bed.

    python benchmarks/engine/devices.py [--beads 4000 100000 1000000] [--seconds 5] [--devices cpu cuda]

Each figure comes from a process of its own, as a process has one device.  The bed is a settled block of D6 beads, set
side by side as its own mirror image.  The positions after the same steps on either device are compared, too.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.engine.speed import ACROSS, BLOCK, bulk, settled_block
from rigtwin.benchmarks.figures import Row, below, machine, report, skipped, small
from rigtwin.sim.engine import backend

Array = npt.NDArray[np.float64]

COMPARED = small(100, 10)  # steps after which positions on both devices are compared
SAME = 1e-6  # diameters, by which they may differ: the devices round differently
PATIENCE = 600  # [s] for one figure


def tiled(block: Array, beads: int) -> tuple[Array, tuple[float, float, float]]:
    """About `beads` beads: the block beside its mirror images, and the size of the box."""
    tiles = max(1, round((beads / len(block)) ** 0.5))
    parts = []
    for i in range(tiles):
        for j in range(tiles):
            part = block.copy()
            part[:, 0] = i * ACROSS + (ACROSS - part[:, 0] if i % 2 else part[:, 0])
            part[:, 1] = j * ACROSS + (ACROSS - part[:, 1] if j % 2 else part[:, 1])
            parts.append(part)
    return np.concatenate(parts), (tiles * ACROSS, tiles * ACROSS, float(block[:, 2].max()) + ACROSS)


def one(device: str, beads: int, seconds: float, block: Array, out: Path) -> None:
    """Run the bed on the device of this process and store its speed and positions."""
    position, size = tiled(block, beads)
    began = time.perf_counter()
    backend.start(device=device)  # type: ignore[arg-type]
    bed = bulk(size, len(position))
    if bed.device != device:
        np.savez(out, note=bed.note or backend.running().note)
        return
    bed.add(position, overlap=0.2)
    bed.run(COMPARED)
    state = bed.beads()
    ready = time.perf_counter() - began
    steps, took = 0, 0.0
    while took < seconds:
        begun = time.perf_counter()
        bed.run(10)
        bed.beads()
        took += time.perf_counter() - begun
        steps += 10
    order = np.argsort(state.ident)
    np.savez(out, speed=steps * len(position) / took, ready=ready, position=state.position[order])


def rows_of(beads: int, options: argparse.Namespace, block: Path) -> list[Row]:
    """Speeds on each device, their ratio, and the largest difference between the positions."""
    found: dict[str, dict[str, Array]] = {}
    rows = []
    for device in options.devices:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out.npz"
            said = [device, str(beads), str(options.seconds), str(block), str(out)]
            try:
                subprocess.run([sys.executable, __file__, "--one", *said], check=True, timeout=PATIENCE)
            except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as fault:
                rows.append(skipped(f"{beads} beads, {device}", str(fault).rpartition("]")[2].strip()))
                continue
            found[device] = dict(np.load(out))
        if "note" in found[device]:
            rows.append(skipped(f"{beads} beads, {device}", str(found.pop(device)["note"])))
            continue
        speed, ready = float(found[device]["speed"]), float(found[device]["ready"])
        note = f"ready after {ready:.1f} s"
        rows.append(Row(f"{beads} beads, {device}", speed / 1e6, "M particle-steps/s", note=note))
        sys.stderr.write(f"{rows[-1].name}: {rows[-1].value:.4g} {rows[-1].unit}, {rows[-1].note}\n")
    if {"cpu", "cuda"} <= found.keys():
        rows.append(Row(f"{beads} beads: cuda over cpu", float(found["cuda"]["speed"] / found["cpu"]["speed"])))
        apart = np.abs(found["cuda"]["position"] - found["cpu"]["position"]).max() / 6e-3
        rows.append(below(f"{beads} beads: positions apart after {COMPARED} steps", float(apart), SAME, unit="d"))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--beads", type=int, nargs="+", default=small([4000, 100_000, 1_000_000], [80]))
    parser.add_argument("--seconds", type=float, default=small(5.0, 0.1))
    parser.add_argument("--devices", nargs="+", choices=("cpu", "cuda"), default=["cpu", "cuda"])
    parser.add_argument("--one", nargs=5, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        device, beads, seconds, block, out = options.one
        one(device, int(beads), float(seconds), np.load(block), Path(out))
        return 0
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        block = Path(folder) / "block.npy"
        np.save(block, settled_block(BLOCK, int(os.environ.get("SEED", "1"))))
        for beads in options.beads:
            rows += rows_of(beads, options, block)
    return report("devices", rows, **machine())


if __name__ == "__main__":
    raise SystemExit(main())
