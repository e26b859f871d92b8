"""The commands and Python lines of README and docs/ are what rigtwin understands, and those of the tutorials run.

A block of code in a page is one of

- ```` ```bash ```` and ```` ```python ````: run from top to bottom, in one folder for each page, beside `sample_media`;
- with ``title="FILE"``: written to that file first;
- anything else: not run, but each line that begins with ``rigtwin`` must be a command that exists, with its options.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer

from rigtwin.cli import app
from rigtwin.lab.file.lab_file import read_lab

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```", re.M | re.S)
INDENTED = re.compile(r"^    (rigtwin (?:.*\\\n)*.*)", re.M)
RUN = ("bash", "python")


class Block(NamedTuple):
    language: str
    title: str
    text: str


def blocks(page: Path) -> list[Block]:
    found = []
    for language, about, text in FENCE.findall(page.read_text("utf-8")):
        title = re.search(r'title="([^"]+)"', about)
        found.append(Block(language, title.group(1) if title else "", text))
    return found


def commands(page: Path) -> Iterator[str]:
    """Lines that begin with ``rigtwin``, without comments; lines that end with a backslash go on in the next."""
    text = page.read_text("utf-8")
    shown = [block.text for block in blocks(page)] + INDENTED.findall(FENCE.sub("", text))
    for part in shown:
        for line in part.replace("\\\n", " ").splitlines():
            if line.strip().startswith("rigtwin "):
                yield line.strip()


EVERY = [(page, line) for page in PAGES for line in dict.fromkeys(commands(page))]


@pytest.mark.parametrize(("page", "line"), EVERY, ids=[f"{p.name}: {c[:60]}" for p, c in EVERY])
def test_a_command_in_the_documentation_exists_with_its_options(
    page: Path, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my-lab").mkdir()
    monkeypatch.chdir(tmp_path)
    words = shlex.split(line, comments=True)[1:]
    command: Any = typer.main.get_command(app)
    name, around = "rigtwin", None
    while hasattr(command, "commands"):  # a group of commands, which may take its first one where none is named
        around = command.make_context(name, words, parent=around)
        left = [*around._protected_args, *around.args]
        if not left:
            return  # a group that does something without a command, and its own options were read
        name, command, words = command.resolve_command(around, left)  # raises where there is no such command
    command.make_context(name, words, parent=around)  # raises where an option or an argument is unknown or missing


def test_commands_of_the_documentation_are_found() -> None:
    assert len(EVERY) > 50
    assert {"README.md", "process_lab.md", "calibration.md"} <= {page.name for page, _ in EVERY}


TABLES = [(page, block) for page in PAGES for block in blocks(page) if block.title.endswith("lab.toml")]


@pytest.mark.parametrize(("page", "block"), TABLES, ids=[block.title for _, block in TABLES])
def test_a_lab_toml_of_the_documentation_has_no_fault(page: Path, block: Block, tmp_path: Path) -> None:
    for name in ("clips/r01.mp4", "photos/view1.jpg", "photos/view2.jpg"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "lab.toml").write_text(block.text, "utf-8")
    assert read_lab(tmp_path).experiments


RUNS = [page for page in PAGES if any(block.language in RUN for block in blocks(page))]


@pytest.mark.slow
@pytest.mark.parametrize("page", RUNS, ids=[page.relative_to(ROOT).as_posix() for page in RUNS])
def test_the_code_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    (tmp_path / "sample_media").symlink_to(ROOT / "sample_media")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    for block in blocks(page):
        if block.title:
            (tmp_path / block.title).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / block.title).write_text(block.text, "utf-8")
        elif block.language in RUN:
            call = [sys.executable, "-c"] if block.language == "python" else ["bash", "-euc"]
            surroundings = os.environ | {"PATH": path}
            done = subprocess.run(
                [*call, block.text], check=False, cwd=tmp_path, env=surroundings, capture_output=True, text=True
            )
            assert done.returncode == 0, f"{page.name}:\n{block.text}\n{done.stdout}{done.stderr}"
