"""Contents of the frame cache, and its size limit."""

from __future__ import annotations

import numpy as np

from rigtwin.measure.media.video import Frame
from rigtwin.measure.scene.background import Background
from rigtwin.measure.tracking import frame_cache
from rigtwin.measure.tracking.detect import Spot
from rigtwin.measure.tracking.frame_cache import Album

SHAPE = (90, 120)


def frame(index: int) -> Frame:
    grey = np.random.default_rng(index).integers(0, 255, SHAPE, dtype=np.uint8)
    return Frame(index, index / 240, grey, lambda: np.repeat(grey[..., None], 3, axis=2))


def test_a_cut_out_at_the_border_holds_the_frame_around_a_spot() -> None:
    kept = Album()
    kept.add(frame(0), [Spot(110.0, 10.0, 30.0, 6.0, 6.0, 40.0)])
    box = (100, 0, 120, 30)
    assert np.array_equal(kept.cut(0, box), frame(0).grey[0:30, 100:120])
    assert kept.times == {0: 0.0}
    assert kept.cut(0, (0, 0, 20, 20)) is None


def test_the_cache_does_not_grow_with_the_clip(monkeypatch) -> None:
    """Something large moves in every frame, and there are far more frames than fit."""
    monkeypatch.setattr(frame_cache, "ROOM", 40 * SHAPE[0] * SHAPE[1])
    kept = Album()
    for index in range(300):
        kept.add(frame(index), [Spot(20.0 + 2 * index % 80, 45.0, 900.0, 30.0, 30.0, 40.0)])
    assert 0 < len(kept.times) <= 40
    assert 11 <= len(kept.greys(0, 300)) <= Background.capacity
    assert kept.cut(299, (60, 40, 70, 50)) is None


def test_frames_without_motion_are_not_kept() -> None:
    kept = Album()
    for index in range(50):
        kept.add(frame(index), [])
    assert not kept.times
    assert not kept.greys(0, 50)
