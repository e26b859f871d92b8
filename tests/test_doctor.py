"""`rigtwin doctor`: what works is said to work, and what does not is said with what to do."""

import json
import os
import subprocess
import sys
from functools import partial
from importlib import metadata
from pathlib import Path

import pytest

from rigtwin.cli import run
from rigtwin.commands import installation

ENGINE_DIES = partial(os._exit, 9)
"""What the engine's process runs in place of the engine; another process knows it without this file."""
ENGINE_ERRS = partial(tuple, (False, "CPU, 2 threads", "/nowhere"))


def checked(capfd) -> tuple[int, dict[str, dict[str, str]]]:
    """Exit code, and the findings by check; only the last one of a check."""
    code = run(["doctor", "--json"])
    out, err = capfd.readouterr()
    assert err == ""
    document = json.loads(out)
    assert document["works"] == (code == 0)
    return code, {one["check"]: one for one in document["checks"]}


def quick(monkeypatch) -> None:
    """Leave out the checks that take seconds."""
    monkeypatch.setattr(installation, "_engine_and_media", lambda: iter(()))


def metadata_of(monkeypatch, requirements: list[str], versions: dict[str, str]) -> None:
    quick(monkeypatch)
    whole = metadata.version

    def version(name: str) -> str:
        if versions.get(name, "as it is") == "":
            raise metadata.PackageNotFoundError(name)
        return versions.get(name) or whole(name)

    monkeypatch.setattr(metadata, "metadata", lambda _name: {"Requires-Python": ">=3.11"})
    monkeypatch.setattr(metadata, "requires", lambda _name: requirements)
    monkeypatch.setattr(metadata, "version", version)


def test_this_installation_works(capfd):
    code, found = checked(capfd)
    for check in ("python", "film", "photo", "network", "engine", "threads"):
        assert found[check]["state"] == "ok", found[check]
    assert {one["check"] for one in found.values() if one["state"] == "failed"} <= {"packages"}
    assert code == (found["packages"]["state"] == "failed")  # a clone may run that is not installed


def test_each_check_is_one_line_that_begins_with_its_state(capfd, monkeypatch):
    metadata_of(monkeypatch, ["numpy>=2"], {})
    assert run(["doctor"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert all(line.split()[0] in ("ok", "warning", "failed", "note") for line in lines)
    assert "ok       packages: all 1 required packages are installed as needed." in lines


@pytest.mark.parametrize(
    ("version", "words"),
    [("2.9.1", "pandas 2.9.1 is installed, >=3.0 is needed"), ("", "pandas is not installed")],
)
def test_a_required_package_that_is_old_or_missing_fails_with_what_to_run(version, words, capfd, monkeypatch):
    metadata_of(monkeypatch, ["numpy>=2", "pandas>=3.0"], {"pandas": version})
    code, found = checked(capfd)
    assert code == 1
    assert found["packages"]["state"] == "failed"
    assert found["packages"]["message"] == f"{words}; run `pip install 'pandas>=3.0'`."


def test_a_package_of_another_system_is_not_asked_for(capfd, monkeypatch):
    metadata_of(monkeypatch, ["numpy>=2", "no-such-package>=1; sys_platform == 'none'"], {})
    assert checked(capfd)[0] == 0


def test_an_old_python_fails(capfd, monkeypatch):
    metadata_of(monkeypatch, ["numpy>=2"], {})
    monkeypatch.setattr("platform.python_version", lambda: "3.10.4")
    code, found = checked(capfd)
    assert (code, found["python"]["state"]) == (1, "failed")
    assert "3.10.4" in found["python"]["message"]


def test_a_missing_extra_is_a_note_with_the_commands_that_need_it(capfd, monkeypatch):
    metadata_of(monkeypatch, ["numpy>=2", 'distributed>=2026.1; extra == "dask"'], {"distributed": ""})
    code, found = checked(capfd)
    assert (code, found["dask"]["state"]) == (0, "note")
    assert "--cluster tcp://" in found["dask"]["message"]
    assert "rigtwin[dask]" in found["dask"]["message"]


def test_a_rigtwin_that_is_not_installed_fails_and_the_other_checks_are_made(capfd, monkeypatch):
    quick(monkeypatch)

    def missing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "metadata", missing)
    monkeypatch.setattr(metadata, "requires", missing)
    code, found = checked(capfd)
    assert (code, found["packages"]["state"]) == (1, "failed")
    assert "pip install" in found["packages"]["message"]
    assert found["threads"]["state"] == "ok"
    assert [name for name, one in found.items() if one["state"] == "failed"] == ["packages"]


def test_an_engine_that_ends_its_process_fails_and_the_other_checks_are_made(capfd, monkeypatch):
    monkeypatch.setattr(installation, "_engine", ENGINE_DIES)
    code, found = checked(capfd)
    assert (code, found["engine"]["state"]) == (1, "failed")
    assert "a process that ran Taichi ended without a result" in found["engine"]["message"]
    assert found["film"]["state"] == found["threads"]["state"] == "ok"


def test_an_engine_that_computes_wrongly_fails(capfd, monkeypatch):
    monkeypatch.setattr(installation, "_engine", ENGINE_ERRS)
    code, found = checked(capfd)
    assert (code, found["engine"]["state"]) == (1, "failed")
    assert "a wrong sum (CPU, 2 threads)" in found["engine"]["message"]


def test_a_film_that_is_decoded_with_other_pictures_fails(monkeypatch):
    from rigtwin.measure.drawing import OverlayVideo

    write = OverlayVideo.write
    monkeypatch.setattr(OverlayVideo, "write", lambda self, picture: write(self, picture // 2))
    (film,) = installation._film()
    assert film.state == "failed"


def test_a_cache_that_may_not_be_written_is_a_warning(tmp_path):
    (tmp_path / "file").touch()
    engine, cache = installation._engine_findings(True, "CPU, 1 threads", str(tmp_path / "file" / "cache"))
    assert (engine.state, cache.state) == ("ok", "warning")
    assert "TI_OFFLINE_CACHE_FILE_PATH" in cache.message


def test_little_memory_and_disk_are_warnings(capfd, monkeypatch):
    import psutil

    metadata_of(monkeypatch, ["numpy>=2"], {})
    scarce = psutil.virtual_memory()._replace(available=10_000_000)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: scarce)
    monkeypatch.setattr("shutil.disk_usage", lambda _path: type("usage", (), {"free": 10_000_000})())
    code, found = checked(capfd)
    assert (code, found["memory"]["state"], found["disk"]["state"]) == (0, "warning", "warning")


def test_the_engine_ends_well_where_nothing_may_be_written_into_the_home(tmp_path):
    """Taichi ends the process with a segmentation fault where it cannot keep its compiled kernels."""
    call = "from rigtwin.sim.engine.self_test import engine_answer; print(engine_answer()[2])"
    home = {"HOME": str(tmp_path / "file" / "home"), "TMPDIR": str(tmp_path)}
    (tmp_path / "file").touch()
    environment = {name: value for name, value in os.environ.items() if name != "TI_OFFLINE_CACHE_FILE_PATH"} | home
    done = subprocess.run(
        [sys.executable, "-c", call], env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    kept = Path(done.stdout.split()[-1])
    assert kept.parent == tmp_path
    assert list(kept.iterdir())
