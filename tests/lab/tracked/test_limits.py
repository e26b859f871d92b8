"""Tables are bounded before memory is taken for their cells."""

from __future__ import annotations

import os
from contextlib import suppress

import numpy as np
import pandas as pd
import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.tracked.read import read_bodies, read_table


def test_a_table_of_more_rows_than_any_film_has_is_refused(tmp_path) -> None:
    path = tmp_path / "long.csv"
    path.write_bytes(b"t,x\n" + b"1,2\n" * 1_000_001)
    with pytest.raises(BadInput, match="1000002 rows, and at most 1000000"):
        read_table(path)


def test_a_small_parquet_file_of_many_rows_is_refused(tmp_path) -> None:
    path = tmp_path / "long.parquet"
    pd.DataFrame({"t": np.zeros(2_000_000)}).to_parquet(path)
    assert path.stat().st_size < 1e5
    with pytest.raises(BadInput, match="2000000 rows"):
        read_table(path)


@pytest.mark.parametrize("name", ["long.csv", "long.xml", "long.parquet"])
def test_a_file_of_many_gigabytes_is_refused_unread(tmp_path, name) -> None:
    with (tmp_path / name).open("wb") as file:
        file.truncate(10**11)
    with pytest.raises(BadInput, match="100000 MB"):
        read_table(tmp_path / name)


@pytest.mark.parametrize("name", ["a.csv", "a.xml", "a.parquet"])
def test_a_pipe_is_no_table(tmp_path, name) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(BadInput, match="a pipe or a device"):
        read_table(tmp_path / name)


def test_a_damaged_parquet_file_is_refused(tmp_path) -> None:
    path = tmp_path / "a.parquet"
    pd.DataFrame({"t": np.arange(50.0), "y": np.arange(50.0)}).to_parquet(path)
    stored, random = path.read_bytes(), np.random.default_rng(3)
    for _ in range(60):
        damaged = bytearray(stored)
        for place in random.integers(0, len(stored), 4):
            damaged[place] = int(random.integers(0, 256))
        path.write_bytes(damaged)
        with suppress(BadInput):
            read_table(path)


def test_a_number_whose_powers_are_infinite_is_refused(tmp_path) -> None:
    (tmp_path / "a.csv").write_text("time_s,x_m,y_m\n0,0,0.1\n0.1,0,1e200\n0.2,0,0.1\n")
    with pytest.raises(
        BadInput, match=r"y_m holds '1e200' in data row 2, which is not a number between -1e\+30 and 1e\+30"
    ):
        read_bodies(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("content", "kind", "name"),
    [
        (b"\0\0\0\x20ftypisom\0\0", r"a film \(MP4\)", r"rename it to track\.mp4\.$"),
        (b"\xff\xd8\xff\xe0\0\0", r"a picture \(JPEG\)", r"rename it to track\.jpg\.$"),
        (b"\0\1\2\3", "not a text file", "give a table of tracked data as CSV or text"),
    ],
)
def test_a_film_or_picture_with_the_ending_of_a_table_is_named(tmp_path, content, kind, name) -> None:
    (tmp_path / "track.txt").write_bytes(content)
    with pytest.raises(BadInput, match=rf"by its ending \.txt, and is {kind}.*{name}"):
        read_table(tmp_path / "track.txt")
