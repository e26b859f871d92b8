"""Reading videos and photos: capture times, orientation, and clear messages for unreadable files."""

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from rigtwin.lab.camera import Camera, Moment, known_length, span
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import BadInput, UnreadableMedia
from rigtwin.measure.media import video_file
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.media.video import open_video


def write_clip(
    path: Path, stamps: list[int], *, rate: int = 30, tick: int = 1000, codec: str = "libx264", group: int = 250
) -> Path:
    """Frame k has grey level 10 + 5 k and time stamp `stamps[k]` / `tick` [s]; a keyframe every `group` frames."""
    with av.open(str(path), "w") as container:
        options = {"x264-params": "mbtree=0"} if codec == "libx264" else {}
        stream = container.add_stream(codec, rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.time_base = Fraction(1, tick)
        stream.codec_context.gop_size = group
        for k, stamp in enumerate(stamps):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 10 + 5 * k, dtype=np.uint8), format="bgr24")
            frame.pts, frame.time_base = stamp, Fraction(1, tick)
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def regular(tmp_path: Path, count: int = 12) -> Path:
    return write_clip(tmp_path / "clip.mp4", [round(k * 1000 / 25) for k in range(count)], rate=25)


def test_frames_come_in_order_with_their_picture_and_time(tmp_path):
    video = open_video(regular(tmp_path), Camera())
    frames = list(video.frames())
    assert [frame.index for frame in frames] == list(range(12))
    assert np.all(np.diff([float(frame.grey.mean()) for frame in frames]) > 3)
    assert [frame.time for frame in frames] == pytest.approx([k / 25 for k in range(12)])
    assert frames[3].colour.shape == (48, 64, 3)
    assert frames[3].colour.mean() == pytest.approx(25, abs=4)  # the codec rounds dark greys


@pytest.mark.parametrize("kept", [10**9, 1, 20000])  # cache holds all, none, the first few pictures
def test_any_part_of_a_video_is_read_the_same_with_and_without_cache(tmp_path, monkeypatch, kept):
    monkeypatch.setattr(video_file, "KEPT", kept)
    stamps = [round(k * 1000 / 25) for k in range(40)]
    video = open_video(write_clip(tmp_path / "clip.mp4", stamps, rate=25, group=2), Camera(frame_rate=25.0))
    for first, last in ((0, 39), (13, 22), (13, 22), (38, 39), (6, 6)):
        frames = list(video.frames(first, last))
        assert [frame.index for frame in frames] == list(range(first, last + 1))
        assert [float(frame.grey.mean()) for frame in frames] == pytest.approx(
            [16 + (10 + 5 * frame.index) * 219 / 255 for frame in frames], abs=2.5
        )
    for count, spacing in ((6, 2), (10, 2)):
        chosen = video.spread(count, quickly=True)
        assert len(chosen) == count
        assert {frame.index for frame in video.single(chosen)} == chosen
        if kept < 10**9:
            assert all(index % spacing == 0 for index in chosen)


def test_damage_is_reported_at_its_place_even_if_only_a_few_pictures_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(video_file, "KEPT", 0)
    clip = write_clip(tmp_path / "clip.mp4", [40 * k for k in range(40)], rate=25, group=10)
    with av.open(str(clip)) as container:
        packets = sorted((packet.pts, packet.pos, packet.size) for packet in container.demux(video=0) if packet.size)
    _, place, size = packets[31]
    content = bytearray(clip.read_bytes())
    content[place : place + size] = b"\xff" * size
    clip.write_bytes(content)
    video = open_video(clip, Camera(frame_rate=25.0))
    for wanted in ([5, 38], [0, 20, 38]):
        with pytest.raises(UnreadableMedia, match=r"damaged after picture 30; .* --end 30f"):
            video.single(wanted)
    assert [frame.index for frame in video.single([5, 30])] == [5, 30]


def test_two_readers_of_one_video_do_not_disturb_each_other(tmp_path):
    video = open_video(regular(tmp_path), Camera())
    both = zip(video.frames(), video.frames(), strict=True)
    assert all(np.array_equal(one.grey, other.grey) for one, other in both)


def test_a_given_capture_rate_replaces_the_playback_rate(tmp_path):
    video = open_video(regular(tmp_path), Camera(frame_rate=500.0))
    assert video.times == pytest.approx(np.arange(12) / 500)
    assert video.playback_rate == pytest.approx(25)


def test_a_frame_rate_read_from_the_file_gives_a_warning(tmp_path):
    clip = regular(tmp_path)
    assert any("frame rate 25 Hz read from the file" in line for line in open_video(clip, Camera()).warnings)
    assert open_video(clip, Camera(frame_rate=25.0)).warnings == ()


def test_dropped_frames_keep_their_true_times(tmp_path):
    stamps = [0, 40, 80, 120, 240, 280, 320, 360, 400, 440]
    video = open_video(write_clip(tmp_path / "gap.mkv", stamps, rate=25), Camera(frame_rate=25.0))
    assert video.times == pytest.approx(np.array(stamps) / 1000, abs=1e-6)
    assert any("frame intervals differ" in line for line in video.warnings)


def test_dropped_frames_of_a_slow_motion_file_are_stretched(tmp_path):
    stamps = [0, 40, 80, 120, 240, 280, 320, 360, 400, 440]
    video = open_video(write_clip(tmp_path / "gap.mkv", stamps, rate=25), Camera(frame_rate=250.0))
    assert video.times == pytest.approx(np.array(stamps) / 10000, abs=1e-6)


def test_frames_missing_between_rounded_time_stamps_leave_the_others_on_time(tmp_path):
    kept = np.array([k for k in range(60) if k % 7 not in (2, 5) and not 20 < k < 26])
    stamps = [round(float(k) * 1000 / 240) for k in kept]
    video = open_video(write_clip(tmp_path / "ms.mkv", stamps, rate=240), Camera(frame_rate=240.0))
    assert video.times == pytest.approx(kept / 240, abs=1e-4)


@pytest.mark.parametrize("name", ["clip.avi", "clip.mkv", "clip.mp4"])
@pytest.mark.parametrize("lost", [{20}, set(range(3, 40, 4)), {5, 6, 17, 30}])
def test_lost_frames_are_counted_even_if_a_tick_is_one_frame(tmp_path, name, lost):
    kept = np.array([k for k in range(40) if k not in lost])
    clip = tmp_path / name
    unit = 1000 if name == "clip.mkv" else 240
    write_clip(clip, np.rint(kept * unit / 240).astype(int).tolist(), rate=240, tick=unit, codec="mpeg4")
    video = open_video(clip, Camera(frame_rate=240.0))
    missing = int(kept[-1]) + 1 - len(kept)
    assert video.times == pytest.approx(kept / 240, abs=2e-4)
    assert any(f"; {missing} frame" in line for line in video.warnings)


@pytest.mark.parametrize("rate", [240, 333, 600, 700, 1000])
@pytest.mark.parametrize("given", [True, False])
def test_millisecond_time_stamps_are_not_taken_for_lost_frames_at_any_rate(tmp_path, rate, given):
    stamps = [round(k * 1000 / rate) for k in range(40)]
    clip = write_clip(tmp_path / "ms.mkv", stamps, rate=rate)
    video = open_video(clip, Camera(frame_rate=float(rate) if given else None))
    assert video.times == pytest.approx(np.arange(40) / rate)
    assert len(video.warnings) == (not given)


@pytest.mark.parametrize("slower", [1, 8])  # real time, and stored at 30 Hz
@pytest.mark.parametrize("name", ["clip.mkv", "clip.mp4"])
def test_a_video_that_later_loses_every_second_frame_keeps_its_time_scale(tmp_path, name, slower):
    taken = np.array([*range(12), *range(12, 50, 2)])
    stamps = np.rint(taken * slower * 1000 / 240).astype(int).tolist()
    video = open_video(write_clip(tmp_path / name, stamps, rate=240 // slower), Camera(frame_rate=240.0))
    assert video.times == pytest.approx(taken / 240, abs=1e-3)
    assert any("are missing" in line for line in video.warnings)


def test_time_stamps_override_a_different_rate_in_the_file_header(tmp_path):
    clip = write_clip(tmp_path / "head.mkv", [round(k * 1000 / 30) for k in range(40)], rate=240)
    video = open_video(clip, Camera())
    assert video.times == pytest.approx(np.arange(40) / 30, rel=2e-3)
    assert (video.frame_rate, video.playback_rate) == pytest.approx((30, 30), rel=2e-3)
    assert any("header states 240 Hz" in line for line in video.warnings)
    fast = open_video(clip, Camera(frame_rate=240.0))
    assert fast.times == pytest.approx(np.arange(40) / 240)
    assert any("plays at 30 Hz" in line and "high-speed" in line for line in fast.warnings)


def test_rounded_time_stamps_of_a_drifting_clock_are_kept(tmp_path):
    taken = np.cumsum(np.random.default_rng(3).uniform(20, 60, 30))
    stamps = np.rint(taken - taken[0]).astype(int)
    video = open_video(write_clip(tmp_path / "phone.mkv", stamps.tolist(), rate=25), Camera(frame_rate=25.0))
    assert video.times == pytest.approx(stamps / 1000, abs=1e-6)


def test_rounding_of_time_stamps_is_not_taken_for_uneven_intervals(tmp_path):
    stamps = [round(k * 1000 / 240) for k in range(40)]  # 4, 4, 5, 4 ms
    video = open_video(write_clip(tmp_path / "ms.mkv", stamps, rate=240), Camera(frame_rate=240.0))
    assert video.times == pytest.approx(np.arange(40) / 240)
    assert video.warnings == ()


def test_time_window_takes_seconds_and_frames(tmp_path):
    clip = regular(tmp_path)
    by_time = open_video(clip, Camera(frame_rate=25.0, start=Moment(0.08, "s"), end=Moment(0.2, "s")))
    by_frame = open_video(clip, Camera(frame_rate=25.0, start=Moment(2, "frame"), end=Moment(5, "frame")))
    assert [frame.index for frame in by_time.frames()] == [2, 3, 4, 5]
    assert [frame.index for frame in by_frame.frames()] == [2, 3, 4, 5]


@pytest.mark.parametrize("line", ["200 mm:0,0,500,0", "200 mm:-10,5,40,40", "2 mm:5,5,5,60"])
def test_a_known_length_outside_the_picture_is_refused(tmp_path, line):
    clip = regular(tmp_path)
    with pytest.raises(BadInput, match=r"--known-length names a point at .* outside the picture of 64 x 48 px"):
        open_video(clip, Camera(known_length=known_length(line)))
    open_video(clip, Camera(known_length=known_length("2 mm:0,0,63,47")))


def test_an_empty_window_is_refused(tmp_path):
    with pytest.raises(BadInput, match="leave 2 frames of 12"):
        open_video(regular(tmp_path), Camera(start=Moment(5, "frame"), end=Moment(6, "frame")))


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "no such file"), (b"", "is empty"), (b"notes, not a film\n" * 50, "cannot be decoded")],
)
def test_a_file_that_is_no_video_is_refused_by_name(tmp_path, content, words):
    path = tmp_path / "clip.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UnreadableMedia, match=words) as caught:
        open_video(path, Camera())
    assert "clip.mp4" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_is_no_video(tmp_path):
    with pytest.raises(UnreadableMedia, match="is a folder"):
        open_video(tmp_path, Camera())


@pytest.mark.parametrize(
    ("end", "beyond"),
    [
        (Moment(11, "frame"), False),  # the last of 12 frames
        (Moment(12, "frame"), False),  # the number of frames
        (Moment(13, "frame"), True),
        (Moment(0.48, "s"), False),  # duration of the clip
        (Moment(0.6, "s"), True),
    ],
)
def test_an_end_beyond_the_clip_gives_a_warning(tmp_path, end, beyond):
    video = open_video(regular(tmp_path), Camera(frame_rate=25.0, end=end))
    assert any("lies beyond the clip" in warning for warning in video.warnings) == beyond
    assert video.last == 11


def test_a_start_beyond_the_clip_is_refused_with_the_clips_end(tmp_path):
    with pytest.raises(BadInput, match=r"--start 100 s lies beyond the clip, whose last picture \(11f\) is at 0.44 s"):
        open_video(regular(tmp_path), Camera(frame_rate=25.0, start=Moment(100, "s")))


def test_sound_alone_is_no_video(tmp_path):
    path = tmp_path / "sound.wav"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), dtype=np.int16), format="s16", layout="mono")
        frame.sample_rate = 8000
        for packet in stream.encode(frame):
            container.mux(packet)
    with pytest.raises(UnreadableMedia, match="holds no video"):
        open_video(path, Camera())


def test_a_photo_is_read_upright_and_in_colour(tmp_path):
    image = np.zeros((20, 30, 3), dtype=np.uint8)
    image[:, :, 2] = 200
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), image)
    assert np.array_equal(read_photo(path)[0], image)


@pytest.mark.parametrize("content", [b"", b"not a picture"])
def test_a_file_that_is_no_photo_is_refused_by_name(tmp_path, content):
    path = tmp_path / "photo.jpg"
    path.write_bytes(content)
    with pytest.raises(UnreadableMedia, match=r"photo\.jpg"):
        read_photo(path)


@pytest.mark.parametrize("kind", ["jpg", "png"])
def test_the_message_for_a_truncated_photo_states_how_much_can_be_read(tmp_path, kind):
    image = np.random.default_rng(3).integers(0, 255, (300, 200, 3), dtype=np.uint8)
    path = tmp_path / f"photo.{kind}"
    content = cv2.imencode(f".{kind}", image)[1].tobytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(UnreadableMedia, match=r"cut off: a photo of 200 x 300 px, .* upper (\d+) rows") as caught:
        read_photo(path)
    rows = int(str(caught.value).partition("upper ")[2].split()[0])
    assert 120 < rows < 180  # noise takes the same number of bytes in every row


def test_the_hash_depends_on_the_content_only(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(b"abc")
    assert sha256(path) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_the_hash_of_a_folder_changes_with_one_picture(tmp_path):
    (tmp_path / "0001.png").write_bytes(b"abc")
    one = sha256(tmp_path)
    assert sha256(tmp_path) == one
    (tmp_path / "0002.png").write_bytes(b"abc")
    assert sha256(tmp_path) != one


@pytest.mark.parametrize(
    ("parts", "left"),
    [
        (["3f..5f"], [0, 1, 2, 6, 7, 8, 9, 10, 11]),
        (["0.12 s..0.2 s"], [0, 1, 2, 6, 7, 8, 9, 10, 11]),
        (["0f..1f", "9.5f..40f"], [2, 3, 4, 5, 6, 7, 8, 9]),
        (["40f..50f"], list(range(12))),
    ],
)
def test_excluded_parts_of_a_clip_are_left_out(tmp_path, parts, left):
    video = open_video(regular(tmp_path), Camera(exclude=tuple(map(span, parts))))
    assert [frame.index for frame in video.frames()] == left
    assert [frame.index for frame in video.single(range(12))] == left
    assert any("beyond the last picture (11f" in warning for warning in video.warnings) == (len(left) == 12)


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ("0.01 s..0.02 s", "--exclude 0.01 s..0.02 s lies between two frames: it leaves nothing out."),
        ("2.2f..2.8f", "--exclude 2.2f..2.8f lies between two frames: it leaves nothing out."),
        ("11.5f..11.9f", "--exclude 11.5f..11.9f lies beyond the last picture (11f at "),
        ("50 s..60 s", "--exclude 50 s..60 s lies beyond the last picture (11f at "),
    ],
)
def test_an_excluded_part_without_a_frame_is_said_beside_others(tmp_path, part, said):
    video = open_video(regular(tmp_path), Camera(exclude=(span("2f..3f"), span(part))))
    (warning,) = (warning for warning in video.warnings if "--exclude" in warning)
    assert warning.startswith(said)
    assert video.excluded == {2, 3}


def test_a_clip_of_which_too_little_is_left_is_refused(tmp_path):
    with pytest.raises(BadInput, match="--exclude leaves fewer than three frames"):
        open_video(regular(tmp_path), Camera(exclude=(span("2f..20f"),)))


@pytest.mark.parametrize("text", ["5f..3f", "0.1 s..4f", "5f", "..", "1f..2f..3f", "-1f..3f"])
def test_a_part_of_a_clip_that_cannot_be_is_refused(text):
    with pytest.raises(BadInput, match="exclude"):
        span(text)
