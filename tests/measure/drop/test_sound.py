"""Impacts are timed by their sound; recordings are synthesised from known times."""

import math
from pathlib import Path

import av
import numpy as np
import pytest
from scipy.io import wavfile

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.measure.drop.measurement import measure
from rigtwin.measure.media.sound import read_sound

RATE = 48000
RESTITUTION, HEIGHT = 0.78, 0.25


def impacts(start: float = 0.6, count: int = 7) -> np.ndarray:
    flights = 2 * math.sqrt(2 * HEIGHT / 9.81) * RESTITUTION ** np.arange(1, count)
    return start + np.concatenate([[0.0], np.cumsum(flights)])


def recording(times, noise: float, rng: np.random.Generator, loudness=None, length: float = 4.0) -> np.ndarray:
    """Decaying sine bursts of an impact at each time, in white noise and a hum."""
    t = np.arange(0, length, 1 / RATE)
    loudness = RESTITUTION ** np.arange(len(times)) if loudness is None else loudness
    sound = noise * rng.normal(0, 1, len(t)) + 0.05 * np.sin(2 * np.pi * 50 * t)
    for time, loud in zip(times, loudness, strict=True):
        since = t - time
        burst = np.exp(-np.clip(since, 0, None) / 0.004) * np.sin(2 * np.pi * rng.uniform(3000, 6000) * since)
        sound += np.where(since > 0, loud * burst, 0.0)
    return sound


def saved(path: Path, sound: np.ndarray) -> Path:
    wavfile.write(path, RATE, np.int16(np.clip(0.3 * sound, -1, 1) * 32767))
    return path


def restitutions(measurement):
    return [q for q in measurement.quantities if q.quantity == "restitution_wall" and q.method == "sound"]


@pytest.mark.parametrize("noise", [1e-4, 0.01, 0.03])
def test_the_restitution_of_every_bounce_is_heard(tmp_path, noise):
    clip = saved(tmp_path / "ball.wav", recording(impacts(), noise, np.random.default_rng(5)))
    found = measure(clip, Camera(), out=tmp_path / "out")
    heard = restitutions(found)
    assert len(heard) == 5
    for each in heard:
        assert not each.doubtful
        assert each.std_uncertainty < 0.02
        assert abs(each.value - RESTITUTION) < 4 * each.std_uncertainty
    height = found.quantity("rebound_height", bounce=1)
    assert abs(height.value - HEIGHT * RESTITUTION**2) < 4 * height.std_uncertainty
    assert height.std_uncertainty < 1e-3
    assert found.files["plot"].exists()


def test_the_stated_uncertainty_covers_the_scatter(tmp_path):
    z = []
    for seed in range(6):
        clip = saved(tmp_path / f"{seed}.wav", recording(impacts(), 0.02, np.random.default_rng(seed)))
        z += [(each.value - RESTITUTION) / each.std_uncertainty for each in restitutions(measure(clip, Camera()))]
    assert len(z) >= 28
    assert np.sqrt(np.mean(np.square(z))) < 1.6


def test_other_clicks_are_left_out(tmp_path):
    rng = np.random.default_rng(8)
    times = np.append(impacts(), [0.75, 1.3, 3.5])
    loudness = np.append(RESTITUTION ** np.arange(7), [0.8, 0.5, 0.9])
    clip = saved(tmp_path / "ball.wav", recording(times, 0.01, rng, loudness))
    found = measure(clip, Camera())
    np.testing.assert_allclose(found.camera["impacts_s"], impacts(), atol=1e-3)
    assert any("3 other clicks" in warning for warning in found.warnings)


def test_a_release_that_is_heard_gives_the_drop_height(tmp_path):
    fall = math.sqrt(2 * HEIGHT / 9.81)
    times = np.append(impacts(), 0.6 - fall)
    clip = saved(
        tmp_path / "ball.wav",
        recording(times, 0.005, np.random.default_rng(2), np.append(RESTITUTION ** np.arange(7), 0.3)),
    )
    height = measure(clip, Camera()).quantity("drop_height")
    assert abs(height.value - HEIGHT) < 0.005
    assert "release" in height.doubtful


@pytest.mark.parametrize("times", [[], [1.0], [1.0, 1.4, 1.9]])
def test_a_recording_without_a_bouncing_body_is_refused(tmp_path, times):
    clip = saved(tmp_path / "nothing.wav", recording(times, 0.02, np.random.default_rng(1)))
    with pytest.raises(NothingToMeasure, match="clicks stand out"):
        measure(clip, Camera())


def test_three_impacts_are_doubtful(tmp_path):
    clip = saved(tmp_path / "ball.wav", recording(impacts(count=3), 0.01, np.random.default_rng(1)))
    (heard,) = restitutions(measure(clip, Camera()))
    assert "only three impacts" in heard.doubtful


def film(path: Path, sound: np.ndarray, frames: int = 60) -> Path:
    """A film of a grey wall with sound."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=30)
        video.width, video.height, video.pix_fmt = 64, 64, "yuv420p"
        audio = container.add_stream("aac", rate=RATE, layout="mono")
        for _ in range(frames):
            container.mux(video.encode(av.VideoFrame.from_ndarray(np.full((64, 64, 3), 128, np.uint8), "rgb24")))
        container.mux(video.encode())
        for start in range(0, len(sound), 1024):
            frame = av.AudioFrame.from_ndarray(
                0.3 * sound[None, start : start + 1024].astype(np.float32), "fltp", "mono"
            )
            frame.sample_rate, frame.pts = RATE, start
            container.mux(audio.encode(frame))
        container.mux(audio.encode())
    return path


def test_a_film_that_shows_nothing_is_measured_by_its_sound(tmp_path):
    clip = film(
        tmp_path / "dark.mp4", recording(impacts(start=0.3, count=5), 0.005, np.random.default_rng(4), length=2.0)
    )
    assert read_sound(clip).rate == RATE
    found = measure(clip, Camera())
    assert any("could not be measured" in warning for warning in found.warnings)
    assert all(abs(each.value - RESTITUTION) < 0.02 for each in restitutions(found))


SAMPLE = Path(__file__).parents[3] / "sample_media" / "drop" / "r01.mp4"


def with_sound_track(path: Path, sound: np.ndarray) -> Path:
    """The sample clip with another sound track."""
    with av.open(str(SAMPLE)) as source, av.open(str(path), "w") as container:
        video = container.add_stream_from_template(source.streams.video[0])
        audio = container.add_stream("aac", rate=RATE, layout="mono")
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = video
                container.mux(packet)
        for start in range(0, len(sound), 1024):
            part = 0.3 * sound[None, start : start + 1024].astype(np.float32)
            frame = av.AudioFrame.from_ndarray(part, "fltp", "mono")
            frame.sample_rate, frame.pts = RATE, start
            container.mux(audio.encode(frame))
        container.mux(audio.encode())
    return path


@pytest.mark.parametrize("pace", [1.0, 1.25])
def test_film_and_sound_are_compared(tmp_path, pace):
    # flights of the sample clip, 190 and 81 ms, from its rendered motion
    times = 0.3 + pace * np.array([0.0, 0.1885, 0.2687])
    clip = with_sound_track(tmp_path / "both.mp4", recording(times, 0.003, np.random.default_rng(6), length=1.0))
    found = measure(clip, Camera(frame_rate=240.0), bead_diameter=0.0062, sound=True)
    (check,) = [each for each in found.checks if each.check == "film_and_sound"]
    assert check.value == pytest.approx(pace, rel=0.01)
    assert check.passed == (pace == 1.0)
    assert any("contradict" in warning for warning in found.warnings) == (pace != 1.0)
    assert len(restitutions(found)) == 1
