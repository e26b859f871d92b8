"""Records come back from their CSV as they were written; a bad table is refused with its place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Profile, Track, write_profile, write_tracks
from rigtwin.lab.tracked.read import read_profiles, read_tracks

SIZES = st.integers(1, 30)
METRES = st.floats(-10, 10, allow_subnormal=False)
SIGMAS = st.floats(1e-7, 1e-2) | st.just(float("nan"))
NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=5)


@st.composite
def tracks(draw, body):
    size = draw(SIZES)
    steps = draw(st.lists(st.floats(1e-4, 1.0), min_size=size, max_size=size))
    rows = draw(st.lists(st.tuples(METRES, METRES, SIGMAS), min_size=size, max_size=size))
    x, y, sigma = np.array(rows).T
    return Track(time=np.cumsum(steps), position=np.column_stack([x, y]), sigma=sigma, body=body)


@settings(deadline=None, derandomize=True)
@given(data=st.data())
def test_tracks_come_back_as_they_were_written(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("tracks") / "track.csv"
    bodies = data.draw(st.lists(NAMES, min_size=1, max_size=3, unique=True))
    written = [data.draw(tracks(body)) for body in bodies]
    write_tracks(path, written)
    for before, after in zip(written, read_tracks(path), strict=True):
        assert after.body == before.body
        np.testing.assert_allclose(after.time, before.time, rtol=1e-8)
        np.testing.assert_allclose(after.position, before.position, rtol=1e-8)
        np.testing.assert_allclose(after.sigma, before.sigma, rtol=1e-2)


@settings(deadline=None, derandomize=True)
@given(data=st.data())
def test_a_profile_comes_back_with_its_unseen_places(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("profiles") / "profile.csv"
    x = np.sort(data.draw(st.lists(METRES, min_size=1, max_size=30, unique=True)))
    heights = np.array(data.draw(st.lists(METRES | st.just(float("nan")), min_size=len(x), max_size=len(x))))
    write_profile(path, Profile(x=x, height=heights, sigma=np.full(len(x), 1e-4)))
    read = read_profiles(path).profiles[0]
    np.testing.assert_allclose(read.x, x, rtol=1e-8)
    np.testing.assert_allclose(read.height, heights, rtol=1e-8)


def test_a_plain_track_without_sigma_and_particle_is_one_bead_of_unknown_sigma(tmp_path):
    path = tmp_path / "track.csv"
    path.write_text("time_s,x_m,y_m\n0,0,0.3\n0.1,0,0.25\n")
    (track,) = read_tracks(path)
    assert track.body == "bead"
    assert np.isnan(track.sigma).all()
    np.testing.assert_array_equal(track.position, [[0, 0.3], [0, 0.25]])


def test_two_bodies_may_alternate_row_by_row(tmp_path):
    path = tmp_path / "track.csv"
    path.write_text("time_s,particle,x_m,y_m\n0,A,1,0\n0,B,2,0\n0.1,A,3,0\n0.1,B,4,0\n")
    a, b = read_tracks(path)
    assert (a.body, b.body) == ("A", "B")
    assert a.position[:, 0].tolist() == [1, 3]
    assert b.time.tolist() == [0, 0.1]


def test_a_moment_in_which_the_bead_was_not_seen_is_left_out(tmp_path):
    path = tmp_path / "track.csv"
    path.write_text("time_s,x_m,y_m\n0,1,1\n0.1,nan,1\n0.2,,\n0.3,2,2\n")
    (track,) = read_tracks(path)
    assert track.time.tolist() == [0, 0.3]


def test_a_profile_is_sorted_from_left_to_right(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text("x_m,height_m\n0.02,1\n-0.01,2\n0,3\n")
    assert read_profiles(path).profiles[0].height.tolist() == [2, 3, 1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no rows"),
        ("time_s,x_m,y_m\n", "no rows"),
        ("time_s,x_m\n0,1\n", "no column for y .* 'time_s', 'x_m'"),
        ("time_s,x_m,y_m\n0,1,2\n\n0.1,1\n", "line 4"),
        ("time_s,x_m,y_m\n0,1,2\n0.1,one,2\n", "'one' in data row 2"),
        ("time_s,x_m,y_m\n0,1,2\n0,1,2\n", "does not rise"),
        ("time_s,x_m,y_m\n0,1,2\nnan,1,2\n", "not a finite number"),
        ("time_s,x_m,y_m\n0,inf,2\n0.1,1,2\n", "not a finite number"),
        ("time_s,x_m,x_m,y_m\n0,1,1,2\n0.1,1,1,2\n", "twice"),
        ("time_s,x_m,y_m\n0,nan,2\n0.1,nan,2\n", "no row holds both"),
    ],
)
def test_a_bad_track_table_is_refused_with_file_and_place(tmp_path, text, words):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=words) as refused:
        read_tracks(path)
    assert "bad.csv" in str(refused.value)


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00\x01garbage", b"a\0b,c\n1,2\n"])
def test_a_file_that_is_missing_or_no_text_is_refused(tmp_path, content):
    path = tmp_path / "bad.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=r"bad\.csv"):
        read_profiles(path)


def test_a_folder_in_place_of_a_table_is_refused(tmp_path):
    with pytest.raises(BadInput, match="is a folder"):
        read_profiles(tmp_path)
