"""What runs leave behind that are killed, find the disk full, or share a folder with another run.

    SEED=1 COUNT=10 python benchmarks/faults.py

COUNT is the number of kills of each command and of pairs of runs.  A killed run must leave whole files only, and the
same command must end as if nothing had happened.  On a disk that is full (a small file system in memory where one may
be mounted, else a limit on the size of a file) a command ends with its result or with one sentence and exit code 2,
and leaves no temporary file.  Of two runs in one folder, one is refused, or both end with their own results.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import av

from rigtwin.benchmarks.figures import Row, report, skipped, small

SEED = int(os.environ.get("SEED", "1"))
COUNT = int(os.environ.get("COUNT", str(small(10, 2))))
LEVELS = small(20, 2)  # of room on a disk
LARGEST_LEVEL = 400_000  # [bytes]; each command here writes more in all, and each file of it less
LONGEST = 300  # [s], of one command

CLIP = Path(__file__).resolve().parent.parent / "sample_media" / "drop" / "r01.mp4"
MEASURE = ("--frame-rate", "240Hz", "--bead-diameter", "6mm", "--quiet")
SIMULATE = (
    "simulate", "pile", "--base-diameter", "50mm", "--rim-height", "6mm", "--count", "150", "--threads", "1", "--quiet",
)  # fmt: skip
LIMITED = (
    "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, ({level}, resource.RLIM_INFINITY)); "
    "from rigtwin.cli import run; sys.exit(run(sys.argv[1:]))"
)


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, negative for a signal, and what it said."""

    code: int
    said: str

    @property
    def well(self) -> bool:
        """Whether it gave a result, or one sentence and exit code 2."""
        return self.code == 0 or (self.code == 2 and self.said.count("\n") <= 1 and "Traceback" not in self.said)


def started(arguments: Sequence[object], *, level: int | None = None) -> subprocess.Popen[str]:
    """A command in a process of its own, with files of at most `level` bytes."""
    begin = ["-m", "rigtwin"] if level is None else ["-c", LIMITED.format(level=level)]
    words = [sys.executable, *begin, *map(str, arguments)]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def ended(process: subprocess.Popen[str]) -> Ended:
    try:
        said = process.communicate(timeout=LONGEST)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        return Ended(-signal.SIGALRM, process.communicate()[1])
    return Ended(process.returncode, said)


def parts(folder: Path) -> list[Path]:
    """Temporary files and locks."""
    return [file for file in folder.rglob("*") if file.suffix in (".part", ".lock", ".cut")]


def broken(folder: Path) -> list[Path]:
    """Files under their final name that are not whole."""
    found = []
    for file in folder.rglob("*"):
        try:
            if file.suffix == ".json":
                json.loads(file.read_text())
            elif file.suffix == ".mp4":
                with av.open(str(file)) as container:
                    next(container.decode(video=0))
            elif (end := {".svg": "</svg>\n", ".csv": "\n"}.get(file.suffix)) and not file.read_text().endswith(end):
                found.append(file)
        except (ValueError, OSError, av.FFmpegError, StopIteration):
            found.append(file)
    return found


def zero(name: str, count: int, of: int, note: str = "") -> Row:
    return Row(name, float(count), "1", 0.0, f"0 of {of}", count == 0, note)


def killed(name: str, command: Callable[[Path], list[object]], record: str, place: Path) -> list[Row]:
    """Kill a command at random moments; it is run again and must give what an undisturbed run gives."""
    chance = random.Random(f"{SEED} {name}")
    began = time.monotonic()
    whole = ended(started(command(place / "whole")))
    seconds = time.monotonic() - began
    damaged, other = 0, 0
    folder = place / "killed"
    for k in range(COUNT):
        process = started(command(folder))
        with suppress(subprocess.TimeoutExpired):
            process.wait(chance.uniform(0.1, 1.0) * seconds)
        process.kill()
        ended(process)
        damaged += len(broken(folder))
        if k % 3 == 2 or k == COUNT - 1:
            after = ended(started(command(folder)))
            kept = (folder / record).read_bytes() if after.code == 0 else b""
            other += kept != (place / "whole" / record).read_bytes()
            if k < COUNT - 1:
                shutil.rmtree(folder, ignore_errors=True)
    return [
        zero(f"{name}: undisturbed run fails", int(whole.code != 0), 1, whole.said[:80]),
        zero(f"{name}: damaged files after a kill", damaged, COUNT),
        zero(f"{name}: other results after kills", other, -(-COUNT // 3)),
        zero(f"{name}: temporary files after the last run", len(parts(folder)), 1),
    ]


def mounted(place: Path, level: int) -> bool:
    """Whether a file system of `level` bytes could be mounted at `place`."""
    place.mkdir(parents=True, exist_ok=True)
    words = ["mount", "-t", "tmpfs", "-o", f"size={level}", "tmpfs", str(place)]
    try:
        return subprocess.run(words, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def full(name: str, command: Callable[[Path], list[object]], place: Path) -> list[Row]:
    """Run a command with ever more room on the disk."""
    wrong: dict[str, list[str]] = {"file system": [], "limit": []}
    left = {"file system": 0, "limit": 0}
    small_disk = place / "disk"
    can_mount = mounted(small_disk, 65536)
    if can_mount:
        subprocess.run(["umount", str(small_disk)], check=False)
    for k in range(LEVELS):
        level = 4096 * (1 + round(LARGEST_LEVEL / 4096 * k / LEVELS))
        for way in ("file system", "limit") if can_mount else ("limit",):
            if way == "file system":
                mounted(small_disk, level)
            try:
                out = small_disk / "out"
                end = ended(started(command(out), level=level if way == "limit" else None))
                wrong[way] += [] if end.well else [f"{level} bytes: exit {end.code}, {end.said[-90:].strip()}"]
                left[way] += len(parts(small_disk))
            finally:
                if way == "file system":
                    subprocess.run(["umount", str(small_disk)], check=False)
                shutil.rmtree(small_disk, ignore_errors=True)
    rows = []
    for way, said in wrong.items():
        if way == "file system" and not can_mount:
            rows.append(skipped(f"{name}, full {way}", "nothing may be mounted here"))
            continue
        rows.append(zero(f"{name}, full {way}: ends in another way", len(said), LEVELS, said[0] if said else ""))
        rows.append(zero(f"{name}, full {way}: temporary files", left[way], LEVELS))
    return rows


def together(place: Path) -> list[Row]:
    """Pairs of runs in one folder or with one checkpoint."""
    wrong, mixed, lost, refused = 0, 0, 0, 0
    for k in range(COUNT):
        folder = place / f"pair{k}"
        clips = [folder / side / "r01.mp4" for side in ("left", "right")]
        for number, clip in enumerate(clips):
            clip.parent.mkdir(parents=True)
            clip.write_bytes(CLIP.read_bytes() + bytes(number))  # other content under one name
        ends = [ended(one) for one in [started(["measure", "drop", c, *MEASURE, "--out", folder / "o"]) for c in clips]]
        wrong += sum(not one.well for one in ends)
        refused += sum(one.code == 2 for one in ends)
        mixed += len(broken(folder / "o")) + len(parts(folder / "o"))
        lost += all(one.code != 0 for one in ends)
    rows = [
        zero("two measure, one folder: ends in another way", wrong, 2 * COUNT),
        zero("two measure, one folder: damaged or temporary files", mixed, COUNT),
        zero("two measure, one folder: neither has results", lost, COUNT),
        Row("two measure, one folder: refused", float(refused)),
    ]
    wrong, lost, spoilt = 0, 0, 0
    for k in range(max(1, COUNT // 3)):
        folder = place / f"seeds{k}"
        kept = folder / "heap.npz"
        seeds = [[*SIMULATE, "--seed", s, "--checkpoint", kept, "--out", folder / f"o{s}"] for s in (1, 2)]
        ends = [ended(one) for one in [started(words) for words in seeds]]
        wrong += sum(not one.well for one in ends)
        winners = [words for words, one in zip(seeds, ends, strict=True) if one.code == 0]
        lost += len(winners) != 1
        spoilt += sum(ended(started(words)).code != 0 for words in winners)
    return [
        *rows,
        zero("two seeds, one checkpoint: ends in another way", wrong, 2 * max(1, COUNT // 3)),
        zero("two seeds, one checkpoint: not exactly one went on", lost, max(1, COUNT // 3)),
        zero("two seeds, one checkpoint: the winner's next run is refused", spoilt, max(1, COUNT // 3)),
    ]


def main() -> int:
    def measure(out: Path) -> list[object]:
        return ["measure", "drop", CLIP, *MEASURE, "--out", out]

    def simulate(out: Path) -> list[object]:
        return [*SIMULATE, "--checkpoint", out / "heap.npz", "--out", out]

    def filmed(suffix: str) -> Callable[[Path], list[object]]:
        return lambda out: [*SIMULATE, "--trajectory", out / f"heap{suffix}", "--out", out]

    with tempfile.TemporaryDirectory(prefix="rigtwin-faults-") as name:
        place = Path(name)
        rows = [
            *killed("measure", measure, "r01-track.csv", place / "m"),
            *killed("simulate with a checkpoint", simulate, "pile-twin-profile-1.csv", place / "s"),
            *full("measure", measure, place / "fm"),
            *full("simulate, .vtkhdf", filmed(".vtkhdf"), place / "fv"),
            *full("simulate, .gsd", filmed(".gsd"), place / "fg"),
            *together(place / "t"),
        ]
    return report("faults", rows, seed=SEED, count=COUNT)


if __name__ == "__main__":
    sys.exit(main())
