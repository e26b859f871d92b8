"""Two beads that collide are looked for in fewer and fewer frames of a high-speed film."""

from __future__ import annotations

from pathlib import Path as File
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt
import pytest

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.measure import two_beads
from rigtwin.measure.meeting import Collision, Path, hanging_place


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

    monkeypatch.setattr(two_beads, "find_paths", paths)
    monkeypatch.setattr(two_beads, "find_collision", collision)
    video = SimpleNamespace(path=File("swing.mp4"), first=5, last=frames + 4)
    return two_beads._collision(video, None, {}, None, None, lambda *_: None)  # type: ignore[arg-type]


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
