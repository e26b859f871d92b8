"""Does a change of the code leave every number as it was?  Two checkouts run the same commands, digit by digit.

    python benchmarks/same_numbers.py --other CHECKOUT [--media DIR ...] [--hidden DIR] [--only SUBSTRING ...] [--quick]
    python benchmarks/same_numbers.py --record FILE [--other CHECKOUT] [--media DIR ...] [--hidden DIR] [--quick]
    python benchmarks/same_numbers.py --against FILE [--record FILE] [--other CHECKOUT] [--only SUBSTRING ...] [--quick]

The first form runs every case here and in the other checkout and compares the two.  The second runs one checkout (this
one, or that of `--other`) and keeps its results, the third compares a checkout with such a file, so that what does not
change is run only once.  A case is one command of `CHECKOUT/.venv/bin/rigtwin`: nothing else of a checkout is used, so
files may move inside the package.

- measure: the sample media, and each folder of each `--media` directory: a clip or photo beside a `given.json` that
  states what a user knows (`kind`, `file`, `bead_diameter_mm` ..., see `GIVEN`).
- simulate: three twins of each rig with fixed seeds and few particles, on one thread.
- diagnose: each folder of `--hidden` that has a `lab.json`.
- compare: both labs of `sample_media`.

Compared are the exit code, the JSON document on stdout and the files that the command wrote: their names, JSON and TOML
as documents, CSV files by a checksum and their means or, where they hold sentences, cell by cell.  Left out are
timings, versions, checksums and the command line (`LEFT_OUT`); paths are relative to the checkout, media or output.
Numbers, names and statuses have to be the same to the last digit.  Sentences (`SENTENCES`) may be worded anew: such
differences are counted apart and fail nothing, but the number of warnings has to stay.

`--record FILE.json` appends each finished case to `FILE.jsonl`, from which a second start of the same checkout goes on,
and writes `FILE.json` when all are done; `--against` reads either.  With both options a comparison that was stopped
goes on where it was, as long as the code is the same.  A case that runs longer than `--limit` is not kept.
Exit code 1 when a number differs; `out/same_numbers.json` holds one row for each case and every difference.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rigtwin.benchmarks.figures import Row, report

HERE = Path(__file__).resolve().parent.parent
FORMAT = 1  # of a record file
LISTED = 12  # differences of one case that are printed; all are in out/same_numbers.json

# Keys of JSON, TOML and columns of CSV that legitimately differ between two runs or two checkouts.
LEFT_OUT = {
    "command_line",
    "cost",
    "cpu_seconds",
    "media_sha256",
    "platform",
    "seconds",
    "seconds_per_particle",
    "sha256",
    "started",
    "steps_per_second",
    "version",
    "versions",
}

# Keys whose text is for reading.  Any other text is a name or a status, unless it has LONG words.
SENTENCES = {
    "assumptions",
    "doubtful",
    "equals",
    "failures",
    "message",
    "next_experiment",
    "noise",
    "note",
    "reason",
    "refused",
    "remarks",
    "stderr",
    "stdout",
    "warnings",
    "where_in_words",
}
LONG = 8

# What `given.json` states and the option that takes it; each kind of rig states only what its command knows.
GIVEN = {
    "bead_diameter_mm": ("--bead-diameter", "mm"),
    "bead_mass_g": ("--bead-mass", "g"),
    "total_mass_g": ("--total-mass", "g"),
    "capture_fps": ("--frame-rate", "Hz"),
    "pendulum_length_mm": ("--length", "mm"),
    "cylinder_inner_diameter_mm": ("--cylinder-diameter", "mm"),
    "base_diameter_mm": ("--base-diameter", "mm"),
    "drum_inner_diameter_mm": ("--drum-diameter", "mm"),
    "rpm": ("--speed", "rpm"),
    "bin_inner_width_mm": ("--bin-width", "mm"),
}

# Sums of many terms depend on how many threads share them.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Case:
    """One command.  Its arguments may hold {checkout}, {media0}, {hidden} ...: the roots of the run."""

    name: str
    arguments: tuple[str, ...]
    quick: bool = False


@dataclass(frozen=True)
class Result:
    """What one command gave, without what may differ."""

    name: str
    arguments: tuple[str, ...]
    quick: bool
    exit_code: int
    document: Any
    files: dict[str, Any]
    stderr: str
    seconds: float


@dataclass
class Differences:
    """Between two results of one case: (path, old, new)."""

    numbers: list[tuple[str, str, str]] = field(default_factory=list)
    wording: list[tuple[str, str, str]] = field(default_factory=list)


# The cases


def cases(media: Sequence[Path], hidden: Path | None) -> list[Case]:
    found = [*sample_media(), *twins()]
    if hidden is not None:
        labs = [lab.parent for lab in sorted(hidden.glob("*/lab.json"))]
        found += [
            Case(f"diagnose {lab.name}", ("diagnose", f"{{hidden}}/{lab.name}"), lab == _smallest(labs)) for lab in labs
        ]
    for number, folder in enumerate(media):
        found += [
            Case(f"measure {folder.name}/{given.parent.name}", given_arguments(given, f"{{media{number}}}"))
            for given in sorted(folder.glob("*/given.json"))
        ]
    found += [
        Case("compare sample_media", ("compare", "{checkout}/sample_media", "--count", "300", "--threads", "1")),
        Case(
            "compare sample_media/seven_rigs",
            ("compare", "{checkout}/sample_media/seven_rigs", "--allow-outside", "--threads", "1"),
        ),
    ]
    if len({case.name for case in found}) < len(found):
        sys.exit("same_numbers: two --media directories have the same name; rename one.")
    return found


def _smallest(labs: Sequence[Path]) -> Path | None:
    """The quickest lab of tracked beads: of heaps, drums and hoppers the diagnosis fits nothing."""
    sizes = {lab: [path.stat().st_size for path in lab.glob("*/*.csv")] for lab in labs}
    tracked = [lab for lab in labs if sizes[lab]]
    return min(tracked, key=lambda lab: sum(sizes[lab]), default=None)


def sample_media() -> list[Case]:
    """What `sample_media/lab.toml` and `sample_media/seven_rigs/lab.toml` state, as options."""
    drop = "--bead-diameter 6.2mm --bead-mass 0.071g --frame-rate 240Hz --known-length 200mm:284.1,723.5,288.5,246.2"
    pendulum = "--length 190mm --bead-diameter 12.2mm --frame-rate 240Hz --known-length 150mm:206.1,446.4,507.7,444.3"
    pile = "--base-diameter 90mm --bead-diameter 6.2mm"
    views = " ".join(f"{{samples}}/pile/view{number}.jpg" for number in (1, 2, 3, 4))
    lines = {
        "drop/r01": f"drop {{samples}}/drop/r01.mp4 {drop}",
        "drop/r02": f"drop {{samples}}/drop/r02.mp4 {drop}",
        "drop/r03": f"drop {{samples}}/drop/r03.mp4 {drop}",
        "drop/r01 without scale": "drop {samples}/drop/r01.mp4 --bead-diameter 6.2mm --frame-rate 240Hz",
        "pendulum/r01": f"pendulum {{samples}}/pendulum/r01.mp4 {pendulum}",
        "pendulum/r02": f"pendulum {{samples}}/pendulum/r02.mp4 {pendulum}",
        "pile/view1": f"pile {{samples}}/pile/view1.jpg {pile}",
        "pile, four views": f"pile {views} {pile}",
        "tilt": "tilt {samples}/seven_rigs/tilt.mp4 --variant slide --bead-diameter 6.2mm --frame-rate 100Hz"
        " --scale 0.5mm/px",
        "packing": "packing {samples}/seven_rigs/packing.jpg --cylinder-diameter 50mm --total-mass 37.6g"
        " --bead-diameter 6.2mm",
        "drum": "drum {samples}/seven_rigs/drum.mp4 --drum-diameter 100mm --speed 6rpm --bead-diameter 6.2mm"
        " --frame-rate 30Hz",
        "hopper": "hopper {samples}/seven_rigs/hopper.mp4 --bin-width 60mm --bead-diameter 6.2mm --frame-rate 120Hz",
        "a file that is not there": "drop {samples}/drop/none.mp4",
    }
    quick = {"drop/r01", "packing", "a file that is not there"}
    return [
        Case(
            f"measure sample_media/{name}",
            ("measure", *line.replace("{samples}", "{checkout}/sample_media").split()),
            name in quick,
        )
        for name, line in lines.items()
    ]


def twins() -> list[Case]:
    """Three of each rig, or of each variant that has code of its own; the quick one of each rig stands first."""
    plate = "--base-diameter 60mm --rim-height 6mm --count 200"
    container = "--method emptying --base-diameter 80mm --count 300"
    conical = "--variant conical --bin-width 70mm --cone-height 50mm --count 200"
    lines = {
        "drop": [
            "--drop-height 300mm",
            "--drop-height 150mm --particle D12 --restitution 0.8 --bounces 8",
            "--drop-height 500mm --particle D6_ABS --wall PMMA",
        ],
        "drop of a clump": [
            "--drop-height 200mm --particle P6x15_3s --seed 1",
            "--drop-height 200mm --particle C6_8s-a --seed 2",
            "--drop-height 120mm --particle C6_8s-a --turned 30deg",
        ],
        "pendulum": [
            "--length 300mm --release-angle 45deg",
            "--length 190mm --release-angle 30deg --variant wall --wall steel --particle D6",
            "--length 190mm --release-angle 50deg --hanger rod --rod-mass 2g",
        ],
        "tilt": [
            "--variant slide --speed 8deg/s",
            "--variant slide --speed 4deg/s --start-angle 12deg --static-friction 0.3 --particle D12",
            "--variant slide --speed 8deg/s --wall PMMA",
            "--variant roll --speed 4deg/s",
            "--variant roll --speed 2deg/s --particle D12 --rolling-friction 0.08",
            "--variant roll --speed 4deg/s --wall PMMA --static-friction 0.5",
        ],
        "packing": [
            "--cylinder-diameter 40mm --count 150 --seed 1",
            "--cylinder-diameter 40mm --count 150 --seed 2 --rolling-model A --contact-law linear",
            "--cylinder-diameter 50mm --count 60 --seed 3 --particle P6x15_3s --hopper-diameter 100mm"
            " --outlet-diameter 40mm",
        ],
        "pile": [
            f"{plate} --method piling --seed 1",
            f"{plate} --method piling --seed 2 --rolling-model A-explicit",
            f"{plate} --method piling --seed 3 --particle C6_8s-a --outlet-height 60mm",
            f"{plate} --method pouring --seed 1",
            f"{plate} --method pouring --seed 2 --contact-law linear",
            f"{plate} --method pouring --seed 3 --lift-speed 40mm/s",
            f"{container} --drain-diameter 36mm --seed 1",
            f"{container} --drain-diameter 36mm --seed 2 --rolling-model A",
            f"{container} --drain-diameter 28mm --seed 3",
            f"{plate} --method emptying",  # refused: a container has no rim
        ],
        "drum": [
            f"--drum-diameter 70mm --depth 25mm {rest}"
            for rest in (
                "--speed 20rpm --count 150 --turns 0.5 --seed 1",
                "--speed 30rpm --fill 0.3 --turns 0.5 --seed 2 --rolling-model A",
                "--speed 20rpm --count 60 --turns 0.3 --seed 3 --particle P6x15_3s",
            )
        ],
        "hopper": [
            "--variant slot --outlet 30mm --bin-width 60mm --depth 30mm --count 150 --seed 1",
            "--variant slot --outlet 30mm --bin-width 60mm --depth 30mm --count 150 --seed 2 --contact-law linear",
            "--variant slot --outlet 40mm --bin-width 80mm --depth 30mm --count 60 --seed 3 --particle P6x15_3s",
            f"{conical} --outlet 30mm --seed 1",
            f"{conical} --outlet 30mm --seed 2 --rolling-model A",
            f"{conical} --outlet 35mm --seed 3",
        ],
    }
    many = {"packing", "pile", "drum", "hopper"}
    quick = {"drop", "pendulum", "packing", "hopper"}
    return [
        Case(
            f"simulate {rig} {number}",
            ("simulate", rig.split()[0], *line.split(), *(("--threads", "1") if rig in many else ())),
            number == 1 and rig in quick,
        )
        for rig, of_rig in lines.items()
        for number, line in enumerate(of_rig, 1)
    ]


def given_arguments(path: Path, root: str) -> tuple[str, ...]:
    """The command that measures a folder as its `given.json` states."""
    given = json.loads(path.read_text())
    options: list[str] = []
    for key, (option, unit) in GIVEN.items():
        value = given.get(key)
        if isinstance(value, int | float):  # a variable frame rate is stated in words: the file's own is used
            options += [option, f"{value:.9g}{unit}"]
    if given["kind"] == "tilt":
        options += ["--variant", "roll" if given["test"] == "rolling" else "slide"]
        arm = re.search(r"arm length ([\d.]+) mm", str(given.get("scale")))
        options += ["--arm-length", f"{arm[1]}mm"] if arm else []
    if given["kind"] == "pendulum":
        options += ["--variant", "double" if given["variant"] == "two beads" else "wall"]
    return ("measure", given["kind"], f"{root}/{path.parent.name}/{given['file']}", *options)


# Running one


class Runner:
    """Runs cases with the `rigtwin` of one checkout."""

    def __init__(self, checkout: Path, roots: dict[str, Path], limit: float) -> None:
        self.program = checkout / ".venv" / "bin" / "rigtwin"
        if not self.program.exists():
            sys.exit(f"same_numbers: {self.program} is not there; run `make lint` in that checkout, which sets it up.")
        self.roots = {"checkout": checkout, **roots}
        self.limit = limit
        self.running: set[subprocess.Popen[str]] = set()
        self.stopped = False

    def stop(self) -> None:
        self.stopped = True
        for process in list(self.running):
            process.kill()

    def __call__(self, case: Case) -> Result | None:
        """None where the command was stopped or ran longer than the limit."""
        arguments = list(case.arguments)
        for name, root in self.roots.items():
            arguments = [argument.replace(f"{{{name}}}", str(root)) for argument in arguments]
        with tempfile.TemporaryDirectory(prefix="same-numbers-") as folder:
            out = Path(folder) / "out"
            begun = time.perf_counter()
            process = subprocess.Popen(
                [str(self.program), *arguments, "--json", "--quiet", "--out", str(out)],
                cwd=folder,
                env={**os.environ, **ONE_THREAD, "COLUMNS": "200"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            self.running.add(process)
            try:
                stdout, stderr = process.communicate(timeout=self.limit)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
                return None
            finally:
                self.running.discard(process)
            if self.stopped:
                return None
            relative = self._paths({"out": out, "folder": Path(folder)})
            try:
                document = cleaned(json.loads(relative(stdout)))
            except ValueError:
                document = {"stdout": relative(stdout)}
            files = {
                str(path.relative_to(out)): contents(path, relative)
                for path in sorted(out.rglob("*"))
                if path.is_file()
            }
        # most commands keep on disk what they print
        files = {name: "as on stdout" if _same_but_files(what, document) else what for name, what in files.items()}
        seconds = round(time.perf_counter() - begun, 1)
        return Result(
            case.name, case.arguments, case.quick, process.returncode, document, files, relative(stderr), seconds
        )

    def _paths(self, more: dict[str, Path]) -> Callable[[str], str]:
        """Absolute paths replaced by the names of their roots, the longest first."""
        known: dict[str, str] = {}
        for name, path in {**self.roots, **more}.items():
            for form in (str(path), str(path.resolve())):
                known.setdefault(form, f"{{{name}}}")
        ordered = sorted(known, key=len, reverse=True)

        def replaced(text: str) -> str:
            for path in ordered:
                text = text.replace(path, known[path])
            return text

        return replaced


def cleaned(document: Any) -> Any:
    """Without what may differ."""
    if isinstance(document, dict):
        return {key: cleaned(value) for key, value in document.items() if key not in LEFT_OUT}
    if isinstance(document, list):
        return [cleaned(value) for value in document]
    return document


def contents(path: Path, relative: Callable[[str], str]) -> Any:
    """What a file holds that can be compared; None of a picture, film or page, of which only the name counts."""
    if path.suffix == ".json":
        return cleaned(json.loads(relative(path.read_text())))
    if path.suffix == ".toml":
        return cleaned(tomllib.loads(relative(path.read_text())))
    if path.suffix == ".csv":
        return table(relative(path.read_text()))
    return None


def table(text: str) -> Any:
    """A CSV as checksum, rows and mean of each column of numbers; one with sentences in it as its rows."""
    header, *rows = list(csv.reader(io.StringIO(text))) or [[]]
    columns = {name: [row[i] for row in rows if i < len(row)] for i, name in enumerate(header) if name not in LEFT_OUT}
    if SENTENCES.intersection(header):
        return [{name: cells[i] for name, cells in columns.items() if i < len(cells)} for i in range(len(rows))]
    checksum = hashlib.sha256(json.dumps(columns).encode()).hexdigest()
    return {"checksum": checksum, "rows": len(rows), "means": {name: _mean(columns[name]) for name in columns}}


def _mean(cells: Sequence[str]) -> float | None:
    try:
        numbers = [float(cell) for cell in cells if cell]
    except ValueError:
        return None
    finite = [number for number in numbers if math.isfinite(number)]
    return math.fsum(finite) / len(finite) if finite else None


def _same_but_files(what: Any, document: Any) -> bool:
    if not isinstance(what, dict) or not isinstance(document, dict):
        return False
    return {**what, "files": None} == {**document, "files": None}


# Comparing two


def compared(old: Result, new: Result) -> Differences:
    found = Differences()
    if old.exit_code != new.exit_code:
        found.numbers.append(("exit code", str(old.exit_code), str(new.exit_code)))
    _walk("stdout", "", old.document, new.document, found)
    _walk("files", "", old.files, new.files, found)
    _walk("stderr", "stderr", old.stderr, new.stderr, found)
    return found


def _walk(path: str, key: str, old: Any, new: Any, found: Differences) -> None:
    """`key` is the last one on the path, which decides whether a text is a sentence."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in [*old, *(name for name in new if name not in old)]:
            inner = f"{path}.{name}"
            if name not in new:
                found.numbers.append((inner, _short(old[name]), "missing"))
            elif name not in old:
                found.numbers.append((inner, "missing", _short(new[name])))
            else:
                _walk(inner, key if key in SENTENCES else name, old[name], new[name], found)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            found.numbers.append((f"{path}, how many", str(len(old)), str(len(new))))
        if key in SENTENCES and all(isinstance(text, str) for text in [*old, *new]):
            gone, come = _unmatched(old, new), _unmatched(new, old)
            found.wording += [(path, gone[i], come[i]) for i in range(min(len(gone), len(come)))]
            return
        for i, (one, other) in enumerate(zip(old, new, strict=False)):
            _walk(f"{path}[{i}]", key, one, other, found)
    elif type(old) is not type(new) or repr(old) != repr(new):
        words = isinstance(old, str) and isinstance(new, str) and _is_sentence(key, old, new)
        (found.wording if words else found.numbers).append((path, _short(old), _short(new)))


def _is_sentence(key: str, old: str, new: str) -> bool:
    """A sentence that comes or goes is a change of status: a number that was in order is doubtful now."""
    if bool(old) != bool(new):
        return False
    return key in SENTENCES or min(len(old.split()), len(new.split())) >= LONG


def _unmatched(these: Sequence[str], those: Sequence[str]) -> list[str]:
    left, rest = list(those), []
    for text in these:
        if text in left:
            left.remove(text)
        else:
            rest.append(text)
    return rest


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 400 else text[:400] + " ..."


# Records on disk


@dataclass
class Record:
    """The results of one checkout; `state` names its commit and what is changed beside it."""

    state: str
    roots: dict[str, str]
    results: dict[str, Result]
    complete: bool = False


def state_of(checkout: Path) -> str:
    """Commit, with a checksum of what is not committed; empty outside git."""

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", "-C", str(checkout), *arguments], capture_output=True, text=True, check=False)
        return done.stdout if done.returncode == 0 else ""

    commit = git("rev-parse", "HEAD").strip()
    changed = git("status", "--porcelain") + git("diff", "HEAD")
    return f"{commit}+{hashlib.sha256(changed.encode()).hexdigest()[:12]}" if changed else commit


def read_record(path: Path) -> Record:
    """A complete record, or the cases so far of one that is being written."""
    if not path.exists() and path.with_suffix(".jsonl").exists():
        path = path.with_suffix(".jsonl")
    if not path.exists():
        sys.exit(f"same_numbers: there is no {path}; --record writes one.")
    if path.suffix == ".jsonl":
        lines = [json.loads(line) for line in path.read_text().splitlines() if line.endswith("}")]
        head, results = lines[0], lines[1:]
    else:
        head = json.loads(path.read_text())
        results = head.pop("results")
    if head.get("format") != FORMAT:
        sys.exit(f"same_numbers: {path} was written by another version of this script; record it anew.")
    read = [_result(each) for each in results]
    return Record(head["state"], head["roots"], {each.name: each for each in read}, path.suffix != ".jsonl")


def _result(entry: dict[str, Any]) -> Result:
    return Result(**{**entry, "arguments": tuple(entry["arguments"])})


class Writer:
    """Appends results to FILE.jsonl and takes up those of an earlier start of the same checkout."""

    def __init__(self, path: Path, state: str, roots: dict[str, Path]) -> None:
        self.path, self.lines = path, path.with_suffix(".jsonl")
        self.head = {"format": FORMAT, "state": state, "roots": {name: str(root) for name, root in roots.items()}}
        self.results: dict[str, Result] = {}
        if self.lines.exists():
            earlier = read_record(self.lines)
            if earlier.state == state:
                self.results = earlier.results
        self._start()

    def _start(self) -> None:
        kept = [self.head, *map(asdict, self.results.values())]
        self.lines.write_text("".join(json.dumps(entry) + "\n" for entry in kept))

    def get(self, case: Case) -> Result | None:
        result = self.results.get(case.name)
        return result if result and result.arguments == case.arguments else None

    def add(self, result: Result) -> None:
        self.results[result.name] = result
        with self.lines.open("a") as lines:
            lines.write(json.dumps(asdict(result)) + "\n")

    def finish(self, wanted: Sequence[Case]) -> None:
        unfinished = self.path.with_suffix(".tmp")
        for case in wanted:
            self.results[case.name] = replace(self.results[case.name], quick=case.quick)
        kept = [asdict(result) for result in self.results.values()]  # those of an earlier start with other cases, too
        unfinished.write_text(json.dumps({**self.head, "results": kept}, indent=1) + "\n")
        unfinished.replace(self.path)


# The three forms


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--other", type=Path, help="another checkout, with its .venv")
    parser.add_argument("--media", type=Path, nargs="+", default=[], help="directories of folders with a given.json")
    parser.add_argument("--hidden", type=Path, help="directory of folders with a lab.json")
    parser.add_argument("--only", nargs="+", default=[], help="cases whose name holds one of these")
    parser.add_argument("--quick", action="store_true", help="a dozen cases of about a minute in all")
    parser.add_argument("--jobs", type=int, default=2, help="commands at a time")
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds that one command may take")
    parser.add_argument("--list", action="store_true", help="print the cases and leave")
    parser.add_argument("--record", type=Path, help="keep the results in this file")
    parser.add_argument("--against", type=Path, help="compare with the results in this file")
    wanted = parser.parse_args()
    if not (wanted.other or wanted.record or wanted.against or wanted.list):
        parser.error("give --other, --record or --against")
    if wanted.record and wanted.record.suffix != ".json":
        parser.error("--record takes a name that ends in .json")
    for folder in [*wanted.media, *filter(None, [wanted.hidden, wanted.other])]:
        if not folder.is_dir():
            parser.error(f"{folder} is no directory")
    return wanted


def main() -> int:
    wanted = parsed()
    roots = {f"media{number}": folder.resolve() for number, folder in enumerate(wanted.media)}
    if wanted.hidden:
        roots["hidden"] = wanted.hidden.resolve()
    other = wanted.other.resolve() if wanted.other else None
    record = read_record(wanted.against) if wanted.against else None
    if record:
        roots = {name: Path(root) for name, root in record.roots.items()} | roots
        chosen = [Case(each.name, each.arguments, each.quick) for each in record.results.values()]
    else:
        chosen = cases([folder.resolve() for folder in wanted.media], roots.get("hidden"))
    chosen = [case for case in chosen if not wanted.only or any(part in case.name for part in wanted.only)]
    chosen = [case for case in chosen if case.quick or not wanted.quick]
    if wanted.list:
        sys.stdout.write("".join(f"{case.name}: {' '.join(case.arguments)}\n" for case in chosen))
        return 0

    checkout = other if other and (wanted.record or wanted.against) else HERE
    mine = Runner(checkout, roots, wanted.limit)
    runners = [mine]
    before: Callable[[Case], Result | None] | None = None
    if record:
        before = lambda case: record.results[case.name]  # noqa: E731
    elif not wanted.record:
        before = Runner(other, roots, wanted.limit)
        runners.append(before)
    writer = Writer(wanted.record.resolve(), state_of(checkout), roots) if wanted.record else None

    def both(case: Case) -> tuple[Result | None, Result | None]:
        kept = writer and writer.get(case)
        return before and before(case), kept or mine(case)

    begun = time.perf_counter()
    outcomes: dict[str, tuple[Result | None, Result | None]] = {}
    for case, (old, new) in each_case(chosen, both, runners, wanted.jobs):
        outcomes[case.name] = old, new
        if writer and new and not writer.get(case):
            writer.add(new)
        sys.stderr.write(f"[{len(outcomes)}/{len(chosen)}] {case.name}: {in_words(old, new)}\n")
        sys.stderr.flush()
    late = [name for name, (_, new) in outcomes.items() if new is None]
    if writer and not late:
        writer.finish(chosen)
        took = time.perf_counter() - begun
        sys.stdout.write(f"{len(chosen)} cases of {checkout}, {took:.0f} s: {wanted.record}\n")
    elif writer:
        sys.stderr.write(f"longer than {wanted.limit:g} s: {', '.join(late)}; {writer.lines} has the rest\n")
    if before is None:
        return 1 if late else 0
    return summary(chosen, outcomes, partial=record is not None and not record.complete)


def in_words(old: Result | None, new: Result | None) -> str:
    if new is None:
        return "stopped at the limit of time"
    if old is None:
        return f"{new.seconds:.0f} s"
    differing = len(compared(old, new).numbers)
    what = f"{differing} numbers differ" if differing else "the same"
    return f"{what}; {new.seconds:.0f} s, before {old.seconds:.0f} s"


def each_case(
    chosen: Sequence[Case], run: Callable[[Case], Any], runners: Sequence[Runner], jobs: int
) -> Iterator[tuple[Case, Any]]:
    """Cases as they end.  An interrupt or `kill` stops the commands that run and starts no other."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        futures = {pool.submit(run, case): case for case in chosen}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for runner in runners:
                runner.stop()
            raise


def summary(chosen: Sequence[Case], outcomes: dict[str, tuple[Result | None, Result | None]], partial: bool) -> int:
    rows, differences, wording = [], [], []
    for case in chosen:
        old, new = outcomes[case.name]
        if old is None or new is None:
            rows.append(Row(case.name, math.nan, "1", 0.0, "no difference", False, "stopped at the limit of time"))
            continue
        found = compared(old, new)
        note = f"wording differs: {len(found.wording)}" if found.wording else ""
        count = len(found.numbers)
        rows.append(Row(case.name, float(count), "1", 0.0, "no difference", count == 0, note))
        differences += [{"case": case.name, "path": path, "old": a, "new": b} for path, a, b in found.numbers]
        wording += [{"case": case.name, "path": path, "old": a, "new": b} for path, a, b in found.wording]
        for path, before, after in found.numbers[:LISTED]:
            sys.stdout.write(f"{case.name}\n    {path}\n    old  {before}\n    new  {after}\n")
        if count > LISTED:
            sys.stdout.write(f"{case.name}: and {count - LISTED} more\n")
    rows += [
        Row("numbers, names, statuses that differ", float(len(differences)), "1", 0.0, "none", not differences),
        Row("wording differs", float(len(wording))),
        Row("cases", float(len(chosen)), note="the record is not complete yet" if partial else ""),
    ]
    return report("same_numbers", rows, differences=differences, wording=wording)


if __name__ == "__main__":
    sys.exit(main())
