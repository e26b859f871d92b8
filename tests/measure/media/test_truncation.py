"""Truncated videos: in a fragmented file a cut is detected except exactly at the end of a fragment."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from rigtwin.measure.media.truncation import breaks_off


def fragmented(path: Path) -> bytes:
    """A fragmented MP4 file; each fragment is announced by its own boxes."""
    random = np.random.default_rng(3)
    options = {"movflags": "dash+frag_keyframe+empty_moov+default_base_moof"}
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=30, options={"g": "5", "x264-params": "mbtree=0"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(30):
            picture = random.integers(0, 255, (48, 64, 3), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return path.read_bytes()


def boxes(film: bytes) -> list[tuple[bytes, int, int]]:
    """Type, begin and end of each box."""
    place, found = 0, []
    while place < len(film):
        length = int.from_bytes(film[place : place + 4], "big")
        found.append((film[place + 4 : place + 8], place, place + length))
        place += length
    return found


def test_a_complete_fragmented_video_is_not_truncated(tmp_path: Path) -> None:
    film = fragmented(tmp_path / "whole.mp4")
    assert {b"moof", b"sidx"} <= {kind for kind, _, _ in boxes(film)}
    assert not breaks_off(tmp_path / "whole.mp4")


@pytest.mark.parametrize("kept", [3, 12, 10_000])
def test_a_video_cut_within_the_boxes_before_a_fragment_is_truncated(tmp_path: Path, kept: int) -> None:
    film = fragmented(tmp_path / "whole.mp4")
    announcing = [box for box in boxes(film) if box[0] in (b"styp", b"sidx", b"moof")]
    assert len(announcing) > 6
    for _, begin, end in announcing[2:]:
        cut = tmp_path / "cut.mp4"
        cut.write_bytes(film[: min(begin + kept, end)])
        assert breaks_off(cut)


def test_a_film_whose_header_is_longer_than_any_file_is_truncated(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(b"\x1a\x45\xdf\xa3" + b"\x01" + b"\x7f" * 7 + bytes(64))
    assert breaks_off(cut)


def test_data_appended_by_a_camera_need_not_be_a_box(tmp_path: Path) -> None:
    plain = tmp_path / "plain.mp4"
    with av.open(str(plain), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"x264-params": "mbtree=0"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")))
        container.mux(stream.encode())
    whole = plain.read_bytes()
    for appended in (b"note\0", b"\0\0\xff\xffuser written by a camera"):
        plain.write_bytes(whole + appended)
        assert not breaks_off(plain)
