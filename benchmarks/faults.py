"""What runs leave behind that are killed, find the disk full, or share a folder with another run.

    SEED=1 COUNT=10 python benchmarks/faults.py

COUNT is the number of kills of each of six commands and of pairs of runs; a third as many runs are interrupted twice
(Ctrl-C, and again within half a second).  A run that is killed or interrupted must leave no process, and whole files
only; the same command must then give what an undisturbed run gives, and leave no temporary file.  On a disk that is
full (a small file system in memory where one may be mounted, else a limit on the size of a file) a command ends with
its result or with one sentence and exit code 2, and leaves no temporary file.  Of two runs in one folder, one is
refused, or both end with their own results.
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
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import av
import psutil

from rigtwin.benchmarks.figures import Row, report, skipped, small
from rigtwin.benchmarks.fuzz_cases.labs import notes
from rigtwin.benchmarks.fuzz_cases.tables import table
from rigtwin.compare.campaign.campaign import run_all
from rigtwin.compare.campaign.run import Result
from rigtwin.compare.campaign.store import Store
from rigtwin.compare.reproduce.tables import plan

SEED = int(os.environ.get("SEED", "1"))
COUNT = int(os.environ.get("COUNT", str(small(10, 1))))
TASKS = small(6, 2)  # commands that are disturbed
LEVELS = small(20, 1)  # of room on a disk
LARGEST_LEVEL = 400_000  # [bytes]; each command here writes more in all, and each file of it less
LONGEST = 300  # [s], of one command

CLIP = Path(__file__).resolve().parent.parent / "sample_media" / "drop" / "r01.mp4"
MEASURE = ("--frame-rate", "240Hz", "--bead-diameter", "6mm", "--quiet", *small((), ("--end", "115f")))
SIMULATE = (
    "simulate", "pile", "--base-diameter", "50mm", "--rim-height", "6mm", "--count", small("150", "40"),
    "--threads", "1", "--quiet",
)  # fmt: skip
SWEEP = (
    "sweep", "packing", "--set", "cylinder_diameter=40mm", "--wall", "PMMA", "--count", "60",
    "--vary", "static_friction=0.1,0.3,0.5,0.7", "--workers", "2", "--quiet",
)  # fmt: skip
CALIBRATE = ("--fit", "static_friction", "--budget", "15", "--workers", "2", "--quiet")
REPRODUCE = ("reproduce", "hlosta2020", "--table", "7", "--quick", "--workers", "2", "--quiet")
FEW_STEPS = "import rigtwin.compare.campaign.posterior as sampler; sampler.STEPS, sampler.BURNT = 60, 20"
LIMITED = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({level}, resource.RLIM_INFINITY))"
ENDS_WITHIN = 20.0  # [s], of the workers of a killed run


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, negative for a signal, and what it said."""

    code: int
    said: str

    @property
    def well(self) -> bool:
        """Whether it gave a result, or one sentence and exit code 2."""
        return self.code == 0 or (self.code == 2 and self.said.count("\n") <= 1 and "Traceback" not in self.said)


def started(arguments: Sequence[object], *, first: str = "", alone: bool = False) -> subprocess.Popen[str]:
    """A command in a process, which runs the Python statements `first`; in a session of its own if it is `alone`."""
    begin = ["-c", f"{first}; from rigtwin.cli import main; main()"]
    words = [sys.executable, *(begin if first else ["-m", "rigtwin"]), *map(str, arguments)]
    return subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=alone
    )


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


@dataclass(frozen=True)
class Task:
    """A command that writes into a folder, and what must be the same whenever it has ended well."""

    name: str
    command: Callable[[Path], list[object]]
    answer: Callable[[Path], object]
    prepare: Callable[[Path], None] = lambda _folder: None  # what stands in the folder before
    first: str = ""  # Python statements that the process runs before


def disturbed(task: Task, place: Path) -> list[Row]:
    """Kill a command, or interrupt it twice, at random moments; then run it again."""
    chance = random.Random(f"{SEED} {task.name}")
    task.prepare(place / "whole")
    began = time.monotonic()
    whole = ended(started(task.command(place / "whole"), first=task.first))
    seconds = time.monotonic() - began
    rows = [zero(f"{task.name}: undisturbed run fails", int(whole.code != 0), 1, whole.said[:80])]
    if whole.code != 0:
        return rows
    answer = task.answer(place / "whole")
    for way, number in {"kill": COUNT, "Ctrl-C twice": -(-COUNT // 3)}.items():
        wrong: dict[str, list[str]] = {}
        for k in range(number):
            folder = place / way / str(k)
            task.prepare(folder)
            moment = chance.uniform(0.1, 1.0) * seconds
            again = chance.uniform(0.0, 0.5) if way == "Ctrl-C twice" else None
            for what in (*_stopped(task, folder, moment, again), *_run_again(task, folder, answer)):
                wrong.setdefault(what.partition(":")[0], []).append(f"at {moment:.2f} of {seconds:.2f} s: {what}")
            shutil.rmtree(folder)
        for what in ("damaged", "a process goes on", "ends in another way", "run again", "temporary"):
            found = wrong.get(what, [])
            rows.append(zero(f"{task.name}, {way}: {what}", len(found), number, "; ".join(found)[:300]))
    return rows


def _stopped(task: Task, folder: Path, moment: float, again: float | None) -> Iterator[str]:
    """Kill a run at a moment [s], or interrupt it then and again some time [s] after; what is wrong after that."""
    process = started(task.command(folder), first=task.first, alone=True)
    with suppress(subprocess.TimeoutExpired):
        process.wait(moment)
    if again is None:
        process.kill()
    else:
        for pause in (again, 0.0):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(pause)
    with suppress(subprocess.TimeoutExpired):
        process.wait(LONGEST)
    _, alive = psutil.wait_procs(_of_session(process.pid), ENDS_WITHIN)
    for one in alive:
        yield f"a process goes on: {' '.join(one.cmdline())[-60:]}"
        one.kill()
    end = ended(process)
    # a shell shows the end by the signal itself as 130, too
    if again is not None and (end.code not in (0, 130, -signal.SIGINT) or "Traceback" in end.said):
        yield f"ends in another way: exit {end.code}, {end.said[-200:].strip()}"
    yield from (f"damaged: {file.name}" for file in broken(folder))


def _of_session(leader: int) -> list[psutil.Process]:
    """The processes that a command has started and left, by the session that it began."""
    found = []
    for process in psutil.process_iter():
        with suppress(OSError, psutil.Error):
            if process.pid != leader and os.getsid(process.pid) == leader:
                found.append(process)
    return found


def _run_again(task: Task, folder: Path, answer: object) -> Iterator[str]:
    begun = time.time()
    after = ended(started(task.command(folder), first=task.first))
    if after.code != 0:
        yield f"run again: exit {after.code}, {after.said[-200:].strip()}"
    elif task.answer(folder) != answer:
        yield "run again: another result"
    old = [file for file in folder.rglob("*") if file.parent.name == "owners" or file.name.endswith("-journal")]
    yield from (f"temporary: {file.name}" for file in (*parts(folder), *old) if file.stat().st_mtime < begun)


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
                end = ended(started(command(out), first=LIMITED.format(level=level) if way == "limit" else ""))
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


def measure(out: Path) -> list[object]:
    return ["measure", "drop", CLIP, *MEASURE, "--out", out]


def content(*names: str) -> Callable[[Path], object]:
    return lambda folder: [(folder / name).read_bytes() for name in names]


def tasks(place: Path) -> Iterator[Task]:
    """The commands that are disturbed; `place` holds their labs."""

    def simulate(out: Path) -> list[object]:
        return [*SIMULATE, "--checkpoint", out / "heap.npz", "--out", out]

    yield Task("measure", measure, content("r01-track.csv"))
    yield Task("simulate with a checkpoint", simulate, content("pile-twin-profile-1.csv"))
    yield Task("sweep", lambda out: [*SWEEP, "--out", out], content("sweep.csv"))
    bed, tracks = a_bed(place / "bed"), six_tracks(place / "tracks")
    calibrate = content("posterior.csv", "model.toml")
    yield Task("calibrate", lambda out: ["calibrate", bed, *CALIBRATE, "--out", out], calibrate, first=FEW_STEPS)
    yield Task("diagnose", lambda out: ["diagnose", tracks, "--quiet", "--out", out], diagnosis)
    yield Task("reproduce", lambda out: [*REPRODUCE, "--out", out], cells, prepare=all_but_one(place / "first"))


def a_bed(folder: Path) -> Path:
    """A lab of one simulated bed."""
    bed = ("simulate", "packing", "--cylinder-diameter", "40mm", "--wall", "PMMA", "--count", "60", "--quiet")
    ended(started([*bed, "--seed", "9000", "--out", folder]))
    text = """[[experiments]]
id = "bed"
rig = "packing"
particle = "D6"
wall = "PMMA"
cylinder_diameter = "40 mm"
count = 60
repetitions = ["packing-twin-profile-1.csv"]
"""
    (folder / "lab.toml").write_text(text)
    return folder


def six_tracks(folder: Path) -> Path:
    """Six tracked repetitions of a drop."""
    folder.mkdir(parents=True)
    for k in range(1, 7):
        (folder / f"r0{k}.csv").write_text(table().replace(",0.0,", f",{1e-4 * k},"))
    (folder / "lab.json").write_text(notes())
    return folder


def diagnosis(folder: Path) -> object:
    """A diagnosis without what depends on the folder and the machine."""
    found = json.loads((folder / "diagnosis.json").read_text())
    return {name: value for name, value in found.items() if name != "cpu_seconds"}


def cells(folder: Path) -> object:
    """The cells of a table without the run times."""
    lines = (folder / "cells.csv").read_text().splitlines()
    return [line for line in lines if ",seconds_per_particle," not in line]


def all_but_one(place: Path) -> Callable[[Path], None]:
    """Fill a store with all runs of a table but the shortest one; all have the result of that one."""
    runs = plan([7], quick=True, repetitions=None, seed=1).runs
    shortest = min(runs, key=lambda run: run.cost)
    kept: list[Result] = []

    def prepare(folder: Path) -> None:
        if not kept:
            kept.append(run_all([shortest], place).results[shortest.name])
        with Store(folder / "runs") as store:
            for run in runs:
                if run is not shortest:
                    store.keep(run, kept[0], 1.0)

    return prepare


def main() -> int:
    def filmed(suffix: str) -> Callable[[Path], list[object]]:
        return lambda out: [*SIMULATE, "--trajectory", out / f"heap{suffix}", "--out", out]

    with tempfile.TemporaryDirectory(prefix="rigtwin-faults-") as name:
        place = Path(name)
        rows = [
            *(row for k, task in enumerate(islice(tasks(place), TASKS)) for row in disturbed(task, place / str(k))),
            *full("measure", measure, place / "fm"),
            *full("simulate, .vtkhdf", filmed(".vtkhdf"), place / "fv"),
            *full("simulate, .gsd", filmed(".gsd"), place / "fg"),
            *together(place / "t"),
        ]
    return report("faults", rows, seed=SEED, count=COUNT)


if __name__ == "__main__":
    sys.exit(main())
