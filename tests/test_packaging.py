"""The wheel carries every folder of the package and nothing else; arrows between the rooms run one way."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.reference.bibliography import reference
from rigtwin.lab.version import RELEASED, __version__

ROOT = Path(__file__).parents[1]
ROOMS = ("lab", "measure", "sim", "compare", "review", "commands")
BELOW = {"lab": set(), "measure": {"lab"}, "sim": {"lab"}, "compare": {"lab", "measure", "sim"}}
BELOW["review"] = BELOW["compare"] | {"compare"}
BELOW["commands"] = BELOW["review"] | {"review"}
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


@cache
def imports(module):
    """The imports in a module, at its head and inside of functions."""
    return [node for node in ast.walk(ast.parse(module.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)]


def test_every_package_folder_is_listed_in_pyproject():
    on_disk = {"rigtwin"} | {
        ".".join(("rigtwin", *init.parent.relative_to(ROOT).parts))
        for room in ROOMS
        for init in (ROOT / room).rglob("__init__.py")
    }
    assert set(SETUPTOOLS["packages"]) == on_disk


def test_no_folder_of_modules_lacks_its_init():
    for room in ROOMS:
        for module in (ROOT / room).rglob("*.py"):
            assert (module.parent / "__init__.py").exists(), module


def test_no_stray_python_file_at_the_root_slips_into_the_wheel():
    assert {path.name for path in ROOT.glob("*.py")} == {"__init__.py", "__main__.py", "api.py", "cli.py"}


def test_every_data_file_inside_the_rooms_is_packaged():
    packaged = {
        path
        for package, patterns in SETUPTOOLS["package-data"].items()
        for pattern in patterns
        for path in ROOT.joinpath(*package.split(".")[1:]).glob(pattern)
    }
    on_disk = {
        path
        for room in ROOMS
        for path in (ROOT / room).rglob("*")
        if path.is_file() and path.suffix not in {".py", ".pyc"}
    }
    assert on_disk == packaged - set(media_of_the_demo())


def media_of_the_demo():
    return [path for pattern in SETUPTOOLS["package-data"]["rigtwin"] for path in ROOT.glob(pattern)]


def test_the_wheel_has_what_the_demo_measures_in_at_most_three_megabytes(tmp_path):
    media = media_of_the_demo()
    assert sum(path.stat().st_size for path in media) <= 3e6
    for path in media:
        (tmp_path / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, tmp_path / path.relative_to(ROOT))
    packed, whole = (read_lab(folder / "sample_media") for folder in (tmp_path, ROOT))
    assert [one.id for one in packed.experiments] == [one.id for one in whole.experiments]
    assert [len(one.repetitions) for one in packed.experiments] == [2, 2, 1]
    assert [len(one.repetitions) for one in whole.experiments] == [3, 2, 1]
    assert len(packed.experiments[2].repetitions[0]) == 4


def test_the_citation_file_is_that_of_this_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    keys = dict(re.findall(r"^([\w-]+): *(.*)$", text, re.MULTILINE))
    assert {"cff-version", "message", "title", "authors", "version", "license"} <= set(keys)  # what the format demands
    assert (keys["version"], keys["date-released"].strip('"')) == (__version__, RELEASED)
    assert f"\n## {__version__} ({RELEASED})\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert keys["title"].strip('"') == reference("rigtwin").fields["title"]
    assert reference("hlosta2020").fields["doi"] in text
    for last, first in reference("hlosta2020").authors:
        assert f"family-names: {last}\n        given-names: {first}\n" in text


@pytest.mark.parametrize("room", ROOMS)
def test_imports_between_the_rooms_run_one_way(room):
    for module in (ROOT / room).rglob("*.py"):
        for node in imports(module):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{module}: relative import"
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            else:
                names = [alias.name for alias in node.names]
            for name in names:
                parts = name.split(".")
                if parts[0] == "rigtwin" and len(parts) > 1:
                    assert parts[1] in BELOW[room] | {room, "__version__"}, f"{module} imports {name}"


def test_the_engine_language_is_imported_in_one_module_only():
    importing = {
        path.relative_to(ROOT).as_posix()
        for room in ROOMS
        for path in (ROOT / room).rglob("*.py")
        for node in imports(path)
        if (isinstance(node, ast.Import) and any(alias.name.split(".")[0] == "taichi" for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "taichi")
    }
    assert importing == {"sim/engine/backend.py"}


def test_evaluating_a_record_needs_no_opencv():
    code = """
import sys, importlib, conftest
from rigtwin.lab.rigs import RIGS
for rig in RIGS:
    importlib.import_module(f"rigtwin.measure.{rig}.evaluate")
    if "cv2" in sys.modules:
        sys.exit(f"the evaluation of a {rig} loads OpenCV")
"""
    subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, check=True, timeout=60)
