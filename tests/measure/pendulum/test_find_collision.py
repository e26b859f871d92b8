"""Search for the collision of two beads, also in every 4th or 16th frame of a high-speed film."""

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
    """Collision found in a film of `frames` frames; `shows` maps a frame step to the step [px] of paths that meet.

    Another object moves by 30 px.
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
    monkeypatch.setattr(track_two_beads, "hung", lambda *_: True)
    video = SimpleNamespace(path=File("swing.mp4"), first=5, last=frames + 4, frames=lambda *_: [])
    return track_two_beads._collision(video, None, {}, None, None, lambda *_: None)  # type: ignore[arg-type]


@pytest.mark.parametrize("shows", [1, 4, 16])
def test_a_collision_found_in_sampled_frames_has_frame_numbers_of_the_film(
    monkeypatch: pytest.MonkeyPatch, shows: int
) -> None:
    first = 0 if shows == 1 else 5  # paths of all frames count the clip's own already
    assert found(monkeypatch, 2000, {shows: 20.0}).rise.frames == [first, first + shows, first + 2 * shows]


@pytest.mark.parametrize(("frames", "shows"), [(2000, 0), (470, 16), (110, 4)])
def test_without_a_collision_the_error_is_that_of_the_search_in_all_frames(
    monkeypatch: pytest.MonkeyPatch, frames: int, shows: int
) -> None:
    with pytest.raises(NothingToMeasure, match=r"one of 1$"):
        found(monkeypatch, frames, {shows: 20.0})


def test_the_collision_of_the_heaviest_paths_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    assert found(monkeypatch, 2000, {1: 2.0, 4: 20.0}).fall.extent == 40
    assert found(monkeypatch, 2000, {1: 2.0}).fall.extent == 4  # another large object moves too, e.g. a hand


def swinging(start: float, end: float, frames: range, size: float) -> Path:
    """From rest at `start` [px] with constant acceleration to `end`."""
    share = (np.arange(len(frames)) / (len(frames) - 1)) ** 2
    return Path(list(frames), [np.array([x, 0.0]) for x in start + share * (end - start)], [size] * len(frames))


@pytest.mark.parametrize("hidden", [0, 3])
def test_large_beads_collide_although_the_end_of_the_fall_is_hardly_seen(hidden: int) -> None:
    """Before the place at which A hangs for long afterwards, in the picture of the still scene, it is hardly seen."""
    fall = swinging(213.0, 330.0, range(46), 47.0)  # by 2.5 diameters
    for k in range(-hidden, 0):
        fall.places[k] = fall.places[k - 1] + np.array([2.0, 0.0])
    speed = 2 * 117.0 / 45
    rise = Path(list(range(53, 90)), [np.array([382.0 + 0.9 * speed * k, 0.0]) for k in range(37)], [47.0] * 37)
    video = SimpleNamespace(path=File("swing.mp4"), first=0, last=100, times=np.arange(101) / 240)
    collision = find_collision([fall, rise], video, in_pieces=False)  # type: ignore[arg-type]
    assert (collision.fall.frames[0], collision.rise.frames[0]) == (0, 53)


def test_the_turn_of_bead_b_at_the_top_of_its_swing_is_no_collision() -> None:
    """The path of A goes on with that of B, which ends slowly; a longer one begins there."""
    hit, turn = 40, 90
    fall = swinging(100.0, 300.0, range(hit), 24.0)
    slower = np.linspace(10.0, 1.6, turn - hit)
    b = Path(
        list(range(hit + 2, turn + 2)), [np.array([x, 0.0]) for x in 330 + np.cumsum(slower)], [24.0] * len(slower)
    )
    end = b.places[-1][0]
    onwards = Path(list(range(turn + 3, turn + 63)), [np.array([end + 1.2 * k, 0.0]) for k in range(60)], [24.0] * 60)
    whole = Path(fall.frames + b.frames, fall.places + b.places, fall.sizes + b.sizes)
    assert find_collision_in([fall, b]).rise.frames[0] == hit + 2
    assert find_collision_in([fall, b, whole, onwards]).rise.frames[0] == hit + 2


@pytest.mark.parametrize("carried_in", [25, 30, 40])
def test_a_hand_that_carries_bead_a_faster_than_it_falls_hides_no_collision(carried_in: int) -> None:
    share = (1 - np.cos(np.linspace(0, np.pi, carried_in))) / 2
    carry = Path(list(range(carried_in)), [np.array([290 - 190 * k, 0.0]) for k in share], [24.0] * carried_in)
    fall = swinging(100.0, 300.0, range(carried_in, carried_in + 100), 24.0)
    hit = carried_in + 100
    rise = Path(list(range(hit + 2, hit + 50)), [np.array([330 + 3.4 * k, 0.0]) for k in range(48)], [24.0] * 48)
    found = find_collision_in([carry, fall, rise])
    assert (found.fall.frames[-1], found.rise.frames[0]) == (hit - 1, hit + 2)


def find_collision_in(paths: list[Path]) -> Collision:
    video = SimpleNamespace(path=File("swing.mp4"), first=0, last=200, times=np.arange(201) / 240)
    return find_collision(paths, video, in_pieces=False)  # type: ignore[arg-type]


@pytest.mark.parametrize("hangs", [True, False])
def test_bead_b_is_sought_where_the_only_bead_that_is_seen_arrives(
    monkeypatch: pytest.MonkeyPatch, hangs: bool
) -> None:
    """B swings before a wall of its own brightness; parts of a thread, much lighter, seem to meet."""
    fall = swinging(100.0, 280.0, range(5, 36), 30.0)
    thread = [swinging(290.0, 330.0, range(20, 41), 4.0), straight(list(range(42, 60)), 2.0)]
    light = Collision(*thread, np.zeros(2), 2.0)
    monkeypatch.setattr(track_two_beads, "find_paths", lambda *_, **__: [fall, *thread])
    monkeypatch.setattr(track_two_beads, "find_collision", lambda *_, **__: light)
    monkeypatch.setattr(track_two_beads, "hung", lambda _, meeting: hangs and meeting.radius > 10)
    video = SimpleNamespace(path=File("swing.mp4"), first=5, last=60, frames=lambda *_: [])
    collision = track_two_beads._collision(video, None, {}, None, None, lambda *_: None)  # type: ignore[arg-type]
    if not hangs:
        assert collision.fall.frames == light.fall.frames
        return
    assert collision.fall.frames[-1] == 35
    assert not collision.rise_seen
    assert collision.rest == pytest.approx([280 + 31, 0])
    assert collision.way == pytest.approx([1, 0])


def test_paths_that_meet_and_are_heavier_than_each_path_come_before_a_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a glare no bead is seen to have hung there; the joined paths of both look like a longer one of A alone."""
    fall, rise = swinging(100.0, 280.0, range(5, 36), 30.0), straight(list(range(37, 60)), 5.0)
    whole = swinging(100.0, 420.0, range(5, 60), 30.0)
    met = Collision(fall, rise, np.array([310.0, 0.0]), 15.0)
    monkeypatch.setattr(track_two_beads, "find_paths", lambda *_, every, **__: [fall, rise] if every == 1 else [whole])
    monkeypatch.setattr(track_two_beads, "find_collision", lambda *_, **__: met)
    monkeypatch.setattr(track_two_beads, "hung", lambda _, meeting: not meeting.rise_seen)
    video = SimpleNamespace(path=File("swing.mp4"), first=0, last=600, frames=lambda *_: [])
    assert track_two_beads._collision(video, None, {}, None, None, lambda *_: None).rise_seen  # type: ignore[arg-type]


@pytest.mark.parametrize(("bead", "background"), [(50.0, 140.0), (210.0, 120.0)])
@pytest.mark.parametrize("creeps", [0.25, 0.0])
def test_the_rest_position_of_b_is_found_although_a_covers_it_later(
    bead: float, background: float, creeps: float
) -> None:
    """A hits at frame 10 and goes on with `creeps` [px/frame], covering most of B's rest position, or stops."""
    random = np.random.default_rng(4)
    radius, hung, level = 7.0, 60.0, 20.0
    wall = background + 4 * random.standard_normal((40, 130))

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


def test_what_bead_a_has_left_is_no_place_of_bead_b() -> None:
    """A is seen to leave, B is not; after a long wait B is sought as far back as where A was released."""
    random = np.random.default_rng(6)
    y, x = np.mgrid[:40, :400]

    def picture(*places: float) -> npt.NDArray[np.uint8]:
        shown = 140 + 2 * random.standard_normal(x.shape)
        for place in places:
            shown[np.hypot(x - place, y - 20) < 10] = 40
        return shown.astype(np.uint8)

    released, hangs, speed = 130.0, 250.0, 4.5
    greys = {k: picture(released) for k in range(0, 20, 3)}  # B hangs before a wall of its own brightness
    greys |= {k: picture() for k in range(62, 80, 3)}
    fall = Path(list(range(20, 42)), [np.array([released + speed * k, 20.0]) for k in range(22)], [20.0] * 22)
    rise = Path(list(range(60, 80)), [np.array([hangs + 30 + speed * k, 20.0]) for k in range(20)], [20.0] * 20)
    expected = np.array([hangs, 20.0])
    assert hanging_place(greys, Collision(fall, rise, expected, 10.5)) == pytest.approx(expected)


HIT, SIZE, PIVOT, LENGTH = 40, 10.0, np.array([200.0, 10.0]), 130.0  # frame; [px]


def at(angle: float, pivot: float = 0.0) -> npt.NDArray[np.float64]:
    """Position [px] of a bead at an angle from the vertical [rad]."""
    return PIVOT + (pivot, 0) + LENGTH * np.array([np.sin(angle), np.cos(angle)])


def cradle(k: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Positions of A and B in frame k: A falls, hits, and nearly stops beside B's rest position."""
    rate = 0.0393  # [rad], of the swing in a frame
    if k <= HIT:
        return at(-0.8 * np.cos(rate * k), -SIZE), at(0.0)
    since = rate * (k - HIT)
    return at(0.06 * np.sin(since), -SIZE), at(0.74 * np.sin(since))


def seen(*, mirrored: bool) -> tuple[list[Path], dict[int, npt.NDArray[np.uint8]], npt.NDArray[np.float64]]:
    """Paths of a cradle (that of B is broken), its frames, and the rest position of B."""
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
def test_a_break_of_a_path_is_no_collision_if_no_bead_hung_there(mirrored: bool) -> None:
    """A reaches B's rest position, so B's rise looks like a continuation of A's fall up to the break."""
    paths, greys, rest = seen(mirrored=mirrored)
    video = SimpleNamespace(path=File("swing.mp4"))
    few = {k: grey for k, grey in greys.items() if k % 4 == 0}

    def shown(meeting: Collision) -> bool:
        return hung(few | {k: greys[k] for k in range(meeting.fall.frames[-1], meeting.rise.frames[0] + 12)}, meeting)

    found = find_collision(paths, video, None, shown, in_pieces=False)  # type: ignore[arg-type]
    assert (found.fall.frames[-1], found.rise.frames[0]) == (HIT - 2, HIT + 2)
    assert hanging_place(greys, found) == pytest.approx(rest, abs=1.5)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_path_past_the_rest_position_is_no_fall_of_a(mirrored: bool) -> None:
    """A path of A that continues along B past its rest position is no fall, nor is a path of B alone."""
    (fall, rise, onwards), greys, rest = seen(mirrored=mirrored)
    passed = Path(fall.frames + rise.frames, fall.places + rise.places, fall.sizes + rise.sizes)
    assert hung(greys, Collision(fall, rise, rest, SIZE / 2))
    assert not hung(greys, Collision(passed, onwards, rest, SIZE / 2))
    assert hung(
        greys, Collision(passed.part(0, len(fall.frames) + 2), onwards, rest, SIZE / 2)
    )  # a short continuation is allowed


def test_paths_of_threads_are_no_collision() -> None:
    (fall, rise, _), _, _ = seen(mirrored=False)
    faint = [
        Path(path.frames, [place - np.array([0.0, 60.0]) for place in path.places], [4.0] * len(path.frames))
        for path in (fall.part(20, 38), rise)
    ]
    video = SimpleNamespace(path=File("swing.mp4"), times=np.arange(80) / 240)

    def shown(meeting: Collision) -> bool:
        return meeting.fall.sizes[0] < SIZE

    assert find_collision([fall, rise, *faint], video, None, shown, in_pieces=False).radius > SIZE / 2  # type: ignore[arg-type]


def test_the_rest_position_of_b_is_found_although_its_rise_is_seen_late() -> None:
    """A pole or a coarse codec hides the begin of the rise, which then points below the rest position."""
    (fall, _, onwards), greys, rest = seen(mirrored=False)
    late = Collision(fall, onwards, rest + np.array([9.0, 12.0]), SIZE / 2)
    few = {k: grey for k, grey in greys.items() if k % 4 == 0 or HIT - 2 < k < HIT + 26}
    assert hanging_place(few, late) == pytest.approx(rest, abs=2)


def test_several_bodies_seen_at_once_are_no_single_pendulum() -> None:
    """As in a film of a drum: they cross the middle in the same frame."""
    film: Any = SimpleNamespace(times=np.arange(60) / 30)
    beads = [
        Path(list(range(60)), [np.array([x + 0.2 * k, 50.0]) for k in range(60)], [9.0] * 60) for x in (0, 200, 5, 205)
    ]
    assert lone_swing(beads, film, 0.191) == ""


def test_the_period_of_a_single_pendulum_gives_its_length() -> None:
    length = 0.25  # [m]
    film: Any = SimpleNamespace(times=np.arange(480) / 120)
    away = 80 * np.cos(np.sqrt(9.81 / length) * film.times)
    bead = Path(list(range(480)), [np.array([200 + x, 50.0]) for x in away], [9.0] * 480)
    assert "that of a pendulum of 250 mm" in lone_swing([bead], film, None)
