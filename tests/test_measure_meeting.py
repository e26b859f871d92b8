"""Two beads that collide are looked for in fewer and fewer frames of a high-speed film."""

from __future__ import annotations

from pathlib import Path as File
from types import SimpleNamespace

import numpy as np
import pytest

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.measure import two_beads
from rigtwin.measure.meeting import Collision, Path


def found(monkeypatch: pytest.MonkeyPatch, frames: int, shows: int) -> Collision:
    """What is made of a film of `frames` in which a collision shows in one of `shows` frames."""

    def paths(*_: object, every: int = 1) -> int:
        return every

    def collision(every: int, *_: object) -> Collision:
        if every != shows:
            raise NothingToMeasure(f"none in one of {every}")
        path = Path([0, 1, 2], [np.zeros(2)] * 3, [9.0] * 3)
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
    assert found(monkeypatch, 2000, shows).rise.frames == [first, first + shows, first + 2 * shows]


@pytest.mark.parametrize(("frames", "shows"), [(2000, 0), (500, 16), (200, 4)])
def test_where_no_frames_show_a_collision_the_error_speaks_of_all_of_them(
    monkeypatch: pytest.MonkeyPatch, frames: int, shows: int
) -> None:
    with pytest.raises(NothingToMeasure, match=r"one of 1$"):
        found(monkeypatch, frames, shows)
