"""A file is whole or as it was; a full disk is named; two runs do not write into one place."""

from __future__ import annotations

import errno
import os
import subprocess
import sys

import pytest

from rigtwin.lab.errors import Claimed
from rigtwin.lab.output_files import claimed_file, claimed_folder, naming, replacing


def test_a_file_that_fails_half_way_is_as_it_was_and_nothing_is_left(tmp_path) -> None:
    path = tmp_path / "heap.csv"
    path.write_text("old")

    def fail() -> None:
        with replacing(path) as part:
            part.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert [file.name for file in tmp_path.iterdir()] == ["heap.csv"]
    assert path.read_text() == "old"


def test_two_writers_of_one_file_have_temporary_files_of_their_own(tmp_path) -> None:
    path = tmp_path / "heap.csv"
    with replacing(path) as one, replacing(path) as other:
        one.write_text("one")
        other.write_text("other")
    assert path.read_text() in ("one", "other")
    assert len(list(tmp_path.iterdir())) == 1


def test_an_error_of_the_disk_that_names_no_file_names_it_then(tmp_path) -> None:
    with pytest.raises(OSError, match=r"heap\.csv") as caught, replacing(tmp_path / "heap.csv"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert caught.value.errno == errno.ENOSPC
    with pytest.raises(FileNotFoundError, match=r"other\.csv"), naming(tmp_path / "heap.csv"):
        open(tmp_path / "other.csv")  # noqa: PTH123, SIM115


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks")
@pytest.mark.parametrize("claim", [claimed_folder, claimed_file])
def test_a_second_run_is_refused_until_the_first_has_ended(tmp_path, claim) -> None:
    place = tmp_path / "results"
    with claim(place, "first"), pytest.raises(Claimed, match="taken"), claim(place, "taken"):
        pass
    with claim(place, "not taken"):
        pass
    assert not list(tmp_path.iterdir())  # neither an empty folder nor a lock is left


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks")
def test_a_killed_run_leaves_no_claim_and_its_temporary_files_are_removed(tmp_path) -> None:
    work = (
        "import sys, time; from pathlib import Path\n"
        "from rigtwin.lab.output_files import claimed_folder, replacing\n"
        f"with claimed_folder(Path({str(tmp_path)!r}), ''), replacing(Path({str(tmp_path / 'a.csv')!r})) as part:\n"
        "    part.write_text('half'); print('ready', flush=True); time.sleep(60)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", work], stdout=subprocess.PIPE, text=True, env=environment) as run:
        assert run.stdout is not None
        if run.stdout.readline().strip() != "ready":
            pytest.skip("the package is not importable in another process")
        with pytest.raises(Claimed), claimed_folder(tmp_path, "taken"):
            pass
        run.kill()
    assert len(list(tmp_path.iterdir())) == 1
    (tmp_path / "notes.part").write_text("not ours")
    with claimed_folder(tmp_path, "taken"):
        assert [file.name for file in tmp_path.iterdir()] == ["notes.part"]
