"""Repeated frames are found, and no other frame is taken for one."""

import av
import cv2
import numpy as np
import pytest

from rigtwin.lab.camera import Camera
from rigtwin.measure.media.duplicate_frames import Repeats, at_its_pace, coarse, without_repeats
from rigtwin.measure.media.frame_loss import repeated
from rigtwin.measure.media.video import open_video


def frames_of_a_bouncing_bead(count, *, noise=2.0, seed=0):
    """A bright disc that falls and rises in front of a grey wall, with noise in every frame."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        picture = np.full((240, 80), 90, dtype=np.uint8)
        phase = (k % 40) - 20  # apex in the middle of every flight of 40 frames
        cv2.circle(picture, (40 * 16, round(16 * (20 + 0.45 * phase**2))), 7 * 16, 190, cv2.FILLED, cv2.LINE_AA, 4)
        yield np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)


def found(frames):
    repeats = Repeats()
    for index, frame in enumerate(frames):
        repeats.add(index, coarse(frame))
    return repeats.frames()


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_no_frame_of_a_clean_clip_is_taken_for_a_repeated_one(noise):
    assert not found(frames_of_a_bouncing_bead(160, noise=noise))


@pytest.mark.parametrize("pattern", [(0, 0), (0, 1, 2, 3, 3), (0, 0, 1, 1, 1)])
def test_repeated_frames_are_found_for_all_usual_patterns(pattern):
    """Every frame twice; 24 frames a second stored as 30; film stored as 60."""
    originals = list(frames_of_a_bouncing_bead(120))
    rng = np.random.default_rng(1)
    step = max(pattern) + 1
    stored, again = [], set()
    for start in range(0, len(originals) - step, step):
        for k, which in enumerate(pattern):
            if k and pattern[k - 1] == which:
                again.add(len(stored))
            # after compression a repeated frame is not bit-identical
            stored.append(np.clip(originals[start + which] + rng.normal(0, 0.3, (240, 80)), 0, 255).astype(np.uint8))
    marked = found(stored)
    assert len(marked & again) > 0.75 * len(again)
    assert len(marked - again) <= 2


@pytest.mark.parametrize("seed", range(4))
def test_periodic_repeats_are_found_although_a_codec_hides_some(seed):
    rng = np.random.default_rng(seed)
    steps = 8 + 6 * np.abs(np.sin(np.arange(183) / 11)) + rng.uniform(0, 1, 183)
    steps[5:180:6] = np.where(np.isin(np.arange(30), rng.choice(30, 6, replace=False)), 6.0, 0.3)
    marked = repeated(steps)
    assert np.array_equal(np.flatnonzero(marked), np.flatnonzero(steps < 1))


def test_apexes_of_flights_at_a_low_frame_rate_are_no_repeated_frames():
    """Ten frames from contact to contact: at every second apex the bead hardly moves for one frame."""
    rng = np.random.default_rng(2)
    steps = np.abs(np.tile([4.5, 3.5, 2.5, 1.5, 0.1, 0.9, 2, 3, 4, 5.0], 8)) + rng.uniform(0, 0.05, 80)
    assert not np.any(repeated(steps))


def test_a_bead_at_rest_gives_no_repeated_frames():
    rng = np.random.default_rng(4)
    assert not np.any(repeated(rng.uniform(0.5, 2.5, 100), noise=2.0))


def doubled_clip(path, count, *, rate=60, every=1):
    """Pictures of which every n-th is stored twice."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": "18", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 80, 240, "yuv420p"
        for number, grey in enumerate(frames_of_a_bouncing_bead(count)):
            for _ in range(2 if number % every == every - 1 else 1):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(np.stack([grey] * 3, axis=-1), format="bgr24")))
        container.mux(stream.encode())
    return path


def test_repeated_frames_of_a_clip_are_skipped(tmp_path):
    video = open_video(doubled_clip(tmp_path / "doubled.mp4", 40), Camera(frame_rate=60))
    read = [frame.index for frame in without_repeats(video).frames()]
    assert len(read) < 46
    assert set(range(0, 80, 2)) <= set(read) | {0}
    assert len(list(video.frames())) == 80


@pytest.mark.parametrize("rate", [30.0, 60.0])  # capture rate, and rate of the file
def test_a_doubled_clip_has_its_true_duration(tmp_path, rate):
    """40 pictures taken at 30 Hz and stored at 60, each twice."""
    video = at_its_pace(open_video(doubled_clip(tmp_path / "doubled.mp4", 40), Camera(frame_rate=rate)))
    assert [frame.time for frame in video.frames()][-1] == pytest.approx(39 / 30, abs=0.05)
    assert any("doubled frames: about 50 %" in line for line in video.warnings) == (rate == 30.0)


@pytest.mark.parametrize("every", [2, 4, 5])
def test_times_are_capture_times_if_every_nth_frame_is_stored_twice(tmp_path, every):
    """80 pictures taken at 60 Hz and stored at 90, 75 or 72 Hz: intervals are 1/60 s and no picture repeats."""
    clip = doubled_clip(tmp_path / "pulldown.mp4", 80, rate=60 + 60 // every, every=every)
    video = at_its_pace(open_video(clip, Camera(frame_rate=60)))
    frames = list(video.frames())
    assert [frame.time for frame in frames] == pytest.approx(np.arange(80) / 60, abs=1e-6)
    shown = [open_video(clip, Camera(frame_rate=60)).single([k + k // every])[0] for k in (0, 17, 41, 70)]
    assert all(np.array_equal(frames[k].grey, one.grey) for k, one in zip((0, 17, 41, 70), shown, strict=True))
    assert [frame.index for frame in video.single([3, 17, 41])] == [3, 17, 41]
    assert len(video.times) == 80
    assert max(video.spread(20, quickly=True)) < 80
    stored = [k + k // every for k in range(80)]
    assert [video.in_file(k) for k in range(80)] == stored
    assert [video.frame_of(k) for k in stored] == list(range(80))
    assert video.frame_of(every) == every - 1
    assert video.file_times[[*stored, every]] == pytest.approx(np.array([*range(80), every - 1]) / 60, abs=1e-6)
    assert video.frame_of(len(video.file_times) + 3) == 83
