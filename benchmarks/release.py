"""Wheel and source archive, installed outside the repository under each Python that is here, run `rigtwin demo`.

    python benchmarks/release.py [--python 3.12 ...] [--count 400]

Both are built with uv from a copy of the tree.  For each Python a new virtual environment gets the wheel (for the first
one another gets the source archive) with its dependencies from the package index, and runs `--help`, `doctor`, `demo`
and the completion of a command, in a folder with a space in its path.  A Python that uv does not find is skipped.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from rigtwin.benchmarks.figures import Row, below, report, skipped, small

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = ("3.11", "3.12", "3.13")
SAMPLE = 3e6  # [bytes], of the media of the demo in the wheel, which everyone who installs downloads
SLOWEST_HELP = 0.5  # [s]
REPORT = ("report.html", "methods.md", "references.bib", "figures/deviations.svg", "figures/deviations.png")
LEFT_OUT = shutil.ignore_patterns(".*", "out", "build", "dist", "*.egg-info", "__pycache__")


def uv() -> str | None:
    """Beside this Python, where `make` puts it, or on the path."""
    beside = Path(sys.executable).with_name("uv")
    return str(beside) if beside.is_file() else shutil.which("uv")


def build(program: str, folder: Path) -> tuple[Path, Path]:
    """The wheel and the source archive."""
    tree = folder / "tree"
    shutil.copytree(ROOT, tree, ignore=LEFT_OUT)
    subprocess.run([program, "build", "--quiet", "--out-dir", folder / "dist", tree], check=True)
    (wheel,), (archive,) = (folder / "dist").glob("*.whl"), (folder / "dist").glob("*.tar.gz")
    return wheel, archive


def contents(wheel: Path, archive: Path) -> Iterator[Row]:
    """Sizes, and the media of the demo."""
    with zipfile.ZipFile(wheel) as packed:
        media = [one.file_size for one in packed.infolist() if "/sample_media/" in one.filename]
    yield Row("wheel", wheel.stat().st_size / 1e6, "MB")
    yield Row("source archive", archive.stat().st_size / 1e6, "MB")
    yield below("media of the demo in the wheel", sum(media) / 1e6, SAMPLE / 1e6, unit="MB", note=f"{len(media)} files")


def python(program: str, version: str) -> str | None:
    """The interpreter of a version, None where there is none."""
    found = subprocess.run(
        [program, "python", "find", "--no-python-downloads", version], capture_output=True, text=True, check=False
    )
    return found.stdout.strip() if found.returncode == 0 else None


def installed(program: str, interpreter: str, package: Path, folder: Path) -> Path:
    """The command `rigtwin` of a new environment."""
    environment = folder / "environment"
    subprocess.run([program, "venv", "--quiet", "--python", interpreter, environment], check=True)
    scripts = environment / ("Scripts" if os.name == "nt" else "bin")
    command = [program, "pip", "install", "--quiet", "--python", scripts / "python", package]
    subprocess.run(command, check=True)
    return scripts / "rigtwin"


def used(rigtwin: Path, name: str, work: Path, count: int) -> Iterator[Row]:
    """What the installed command does in a folder of its own."""
    alone = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}

    def run(*words: str, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [rigtwin, *words], cwd=work, env=alone | more, capture_output=True, text=True, check=False
        )

    times = []
    for _ in range(6):  # the first one compiles byte code
        begun = os.times()
        run("--help")
        ended = os.times()
        spent = ended.children_user + ended.children_system - begun.children_user - begun.children_system
        times.append(spent or ended.elapsed - begun.elapsed)  # Windows does not count the time of children
    yield below(f"{name}: --help, processor time", min(times), SLOWEST_HELP, unit="s")
    completed = run(_RIGTWIN_COMPLETE="complete_bash", COMP_WORDS="rigtwin simu", COMP_CWORD="1")
    yield passed(f"{name}: completion", completed.stdout.split() == ["simulate"], completed.stderr)
    doctor = run("doctor")
    failed = [line for line in doctor.stdout.splitlines() if line.startswith("failed")]
    yield passed(f"{name}: doctor", doctor.returncode == 0, "; ".join(failed) or doctor.stderr)
    begun = time.perf_counter()
    demo = run("demo", "--count", str(count), "--out", "results of the demo", "--json")
    seconds = time.perf_counter() - begun
    yield passed(f"{name}: demo", demo.returncode == 0, demo.stdout or demo.stderr)
    if demo.returncode == 0:
        out = work / "results of the demo"
        rows = json.loads(demo.stdout)["deviations"]
        yield Row(f"{name}: demo, run time", seconds, "s", note=f"{len(rows)} rows")
        missing = [file for file in REPORT if not (out / file).is_file()]
        yield passed(f"{name}: report and figures", not missing, ", ".join(missing))
        versions = json.loads((out / "provenance.json").read_text(encoding="utf-8"))["versions"]
        yield passed(f"{name}: is this Python", versions["python"].startswith(name.split()[1]), versions["python"])


def passed(name: str, well: bool, note: str = "") -> Row:
    """A row that is wanted to be 1."""
    return Row(name, float(well), wanted="1", passed=well, note="" if well else note.strip()[-200:])


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", metavar="3.12", help="a version of Python; may be given again")
    parser.add_argument("--count", type=int, default=400, help="particles of the heap of the demo")
    options = parser.parse_args(arguments)
    program = uv()
    if program is None:
        return report("release", [skipped("wheel", "uv is not installed")])
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="rigtwin release ") as name:
        folder = Path(name)
        packages = build(program, folder)
        rows += contents(*packages)
        first = True
        for version in small(options.python or PYTHONS, ()):
            interpreter = python(program, version)
            if interpreter is None:
                rows.append(skipped(f"Python {version}", "is not installed"))
                continue
            for kind, package in zip(("wheel", "archive"), packages if first else packages[:1], strict=False):
                work = folder / f"{version} {kind}"
                work.mkdir()
                rigtwin = installed(program, interpreter, package, work)
                rows += used(rigtwin, f"Python {version} {kind}", work, options.count)
            first = False
    return report("release", rows)


if __name__ == "__main__":
    sys.exit(main())
