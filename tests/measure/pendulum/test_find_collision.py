"""Two beads that collide are looked for in fewer and fewer frames of a high-speed film."""

from __future__ import annotations

from pathlib import Path as File
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.measure.pendulum import track_two_beads
from rigtwin.measure.pendulum.find_collision import Collision, Path, find_collision, hanging_place, hung, lone_swing


def straight(frames: list[int], step: float) -> Path:
    return Path(frames, [np.array([step * k, 0.0]) for k in range(len(frames))], [9.0] * len(frames))


def found(monkeypatch: pytest.MonkeyPatch, frames: int, shows: dict[int, float]) -> Collision:
    """What is made of a film of `frames` in which, looked at so sparsely, paths of so large steps [px] meet.

    Something moves by 30 px.
    """

    def paths(*_: object, every: int = 1) -> list[Path]:
        return [straight([every, 2 * every], 30.0)]

    def collision(paths: list[Path], *_: object, in_pieces: bool) -> Collision:
        every = paths[0].frames[0]
        if every not in shows:
            raise NothingToMeasure(f"none in one of {every}")
        path = straight([0, 1, 2], shows[every])
        return Collision(path, path, np.zeros(2), 4.5)

    monkeypatch.setattr(track_two_beads, "find_paths", paths)
    monkeypatch.setattr(track_two_beads, "find_collision", collision)
    video = SimpleNamespace(path=File("swing.mp4"), first=5, last=frames + 4)
    return track_two_beads._collision(video, None, {}, None, None, lambda *_: None)  # type: ignore[arg-type]


@pytest.mark.parametrize("shows", [1, 4, 16])
def test_a_collision_that_shows_in_fewer_frames_is_told_in_the_films_own(
    monkeypatch: pytest.MonkeyPatch, shows: int
) -> None:
    first = 0 if shows == 1 else 5  # paths of all frames count the clip's own already
    assert found(monkeypatch, 2000, {shows: 20.0}).rise.frames == [first, first + shows, first + 2 * shows]


@pytest.mark.parametrize(("frames", "shows"), [(2000, 0), (500, 16), (200, 4)])
def test_where_no_frames_show_a_collision_the_error_speaks_of_all_of_them(
    monkeypatch: pytest.MonkeyPatch, frames: int, shows: int
) -> None:
    with pytest.raises(NothingToMeasure, match=r"one of 1$"):
        found(monkeypatch, frames, {shows: 20.0})


def test_glimpses_of_threads_that_seem_to_meet_do_not_outdo_the_beads(monkeypatch: pytest.MonkeyPatch) -> None:
    assert found(monkeypatch, 2000, {1: 2.0, 4: 20.0}).fall.extent == 40
    assert found(monkeypatch, 2000, {1: 2.0}).fall.extent == 4  # something large moves besides, a hand say


@pytest.mark.parametrize(("bead", "ground"), [(50.0, 140.0), (210.0, 120.0)])
@pytest.mark.parametrize("creeps", [0.25, 0.0])
def test_where_b_hung_is_told_though_a_comes_to_hide_it(bead: float, ground: float, creeps: float) -> None:
    """A hits at frame 10 and goes on by so much [px/frame], before most of B's place, or stays where it hit."""
    random = np.random.default_rng(4)
    radius, hung, level = 7.0, 60.0, 20.0
    wall = ground + 4 * random.standard_normal((40, 130))

    def picture(*places: float) -> npt.NDArray[np.uint8]:
        shown = wall + 2 * random.standard_normal(wall.shape)
        y, x = np.mgrid[:40, :130]
        for place in places:
            shown[np.hypot(x - place, y - level) < radius] = bead
        return np.clip(shown, 0, 255).astype(np.uint8)

    def at_hit(k: int) -> tuple[float, float]:
        return (hung - 2 * radius + 4.0 * (k - 10), hung) if k < 10 else (hung - 2 * radius + creeps * (k - 10), hung)

    greys = {k: picture(at_hit(k)[0], hung + 3.4 * max(k - 10, 0)) for k in (*range(0, 10, 2), *range(10, 22))}
    greys |= {k: picture(hung - 2 * radius + creeps * (k - 10)) for k in range(45, 60)}
    fall = Path(list(range(9)), [np.array([at_hit(k)[0], level]) for k in range(9)], [2 * radius] * 9)
    rise = Path(
        list(range(13, 22)), [np.array([hung + 3.4 * (k - 10), level]) for k in range(13, 22)], [2 * radius] * 9
    )
    place = hanging_place(greys, Collision(fall, rise, np.array([hung + 8, level]), radius))
    assert place == pytest.approx([hung, level], abs=1.5)


HIT, SIZE, PIVOT, LENGTH = 40, 10.0, np.array([200.0, 10.0]), 130.0  # frame; [px]


def at(angle: float, pivot: float = 0.0) -> npt.NDArray[np.float64]:
    """[px], of a bead so far from the vertical [rad]."""
    return PIVOT + (pivot, 0) + LENGTH * np.array([np.sin(angle), np.cos(angle)])


def cradle(k: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Where A and B are in frame k: A falls, hits, and nearly stays beside where B hung."""
    rate = 0.0393  # [rad], of the swing in a frame
    if k <= HIT:
        return at(-0.8 * np.cos(rate * k), -SIZE), at(0.0)
    since = rate * (k - HIT)
    return at(0.06 * np.sin(since), -SIZE), at(0.74 * np.sin(since))


def seen(*, mirrored: bool) -> tuple[list[Path], dict[int, npt.NDArray[np.uint8]], npt.NDArray[np.float64]]:
    """The paths of a cradle of which B's is broken, frames of it, and where B hung."""
    ways = {k: cradle(k) for k in range(80)}
    random = np.random.default_rng(7)
    y, x = np.mgrid[:170, :400]
    greys = {}
    for k, beads in ways.items():
        shown = 120 + 3 * random.standard_normal(x.shape)
        for place in beads:
            shown[np.hypot(x - place[0], y - place[1]) < SIZE / 2] = 200
        greys[k] = shown.astype(np.uint8)
    spans = ((0, 0, HIT - 1), (1, HIT + 2, HIT + 14), (1, HIT + 14, 80))
    paths = [
        Path(list(range(first, last)), [ways[k][bead] for k in range(first, last)], [SIZE] * (last - first))
        for bead, first, last in spans
    ]
    rest = at(0.0)
    if mirrored:
        greys = {k: grey[:, ::-1] for k, grey in greys.items()}
        paths = [Path(path.frames, [np.array([399 - u, v]) for u, v in path.places], path.sizes) for path in paths]
        rest = np.array([399 - rest[0], rest[1]])
    return paths, greys, rest


@pytest.mark.parametrize("mirrored", [False, True])
def test_where_a_path_is_broken_nothing_is_hit_for_nothing_hung_there(mirrored: bool) -> None:
    """A comes to where B hung, so that B's rise seems to be A's fall that goes on, up to where B's path is broken."""
    paths, greys, rest = seen(mirrored=mirrored)
    video = SimpleNamespace(path=File("swing.mp4"))
    few = {k: grey for k, grey in greys.items() if k % 4 == 0}

    def shown(meeting: Collision) -> bool:
        return hung(few | {k: greys[k] for k in range(meeting.fall.frames[-1], meeting.rise.frames[0] + 12)}, meeting)

    found = find_collision(paths, video, None, shown, in_pieces=False)  # type: ignore[arg-type]
    assert (found.fall.frames[-1], found.rise.frames[0]) == (HIT - 2, HIT + 2)
    assert hanging_place(greys, found) == pytest.approx(rest, abs=1.5)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_bead_does_not_pass_the_one_that_it_hits(mirrored: bool) -> None:
    """A's path that runs on along B's, past where it hung, is none; nor is one of B alone."""
    (fall, rise, onwards), greys, rest = seen(mirrored=mirrored)
    passed = Path(fall.frames + rise.frames, fall.places + rise.places, fall.sizes + rise.sizes)
    assert hung(greys, Collision(fall, rise, rest, SIZE / 2))
    assert not hung(greys, Collision(passed, onwards, rest, SIZE / 2))
    assert hung(greys, Collision(passed.part(0, len(fall.frames) + 2), onwards, rest, SIZE / 2))  # it only runs on


def test_threads_that_seem_to_meet_are_no_collision_though_something_left_there() -> None:
    (fall, rise, _), _, _ = seen(mirrored=False)
    faint = [
        Path(path.frames, [place - np.array([0.0, 60.0]) for place in path.places], [4.0] * len(path.frames))
        for path in (fall.part(20, 38), rise)
    ]
    video = SimpleNamespace(path=File("swing.mp4"), times=np.arange(80) / 240)

    def shown(meeting: Collision) -> bool:
        return meeting.fall.sizes[0] < SIZE

    assert find_collision([fall, rise, *faint], video, None, shown, in_pieces=False).radius > SIZE / 2  # type: ignore[arg-type]


def test_where_b_hung_is_told_though_it_is_seen_only_far_up_its_way() -> None:
    """A pole or a coarse codec hides its rise at first: its way then points below where it hung."""
    (fall, _, onwards), greys, rest = seen(mirrored=False)
    late = Collision(fall, onwards, rest + np.array([9.0, 12.0]), SIZE / 2)
    few = {k: grey for k, grey in greys.items() if k % 4 == 0 or HIT - 2 < k < HIT + 26}
    assert hanging_place(few, late) == pytest.approx(rest, abs=2)


def test_bodies_that_are_seen_at_once_are_no_lone_pendulum() -> None:
    """As of a film of a drum: they cross the middle in one and the same frame."""
    film: Any = SimpleNamespace(times=np.arange(60) / 30)
    beads = [
        Path(list(range(60)), [np.array([x + 0.2 * k, 50.0]) for k in range(60)], [9.0] * 60) for x in (0, 200, 5, 205)
    ]
    assert lone_swing(beads, film, 0.191) == ""


def test_a_lone_pendulum_tells_its_length() -> None:
    length = 0.25  # [m]
    film: Any = SimpleNamespace(times=np.arange(480) / 120)
    away = 80 * np.cos(np.sqrt(9.81 / length) * film.times)
    bead = Path(list(range(480)), [np.array([200 + x, 50.0]) for x in away], [9.0] * 480)
    assert "as a pendulum of 250 mm" in lone_swing([bead], film, None)
