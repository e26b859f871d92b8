"""Pictures of clips and photos are those that the measurement sees, whichever is asked for next."""

import os
from concurrent.futures import ThreadPoolExecutor

import av
import cv2
import numpy as np
import pytest

from rigtwin.lab.camera import Camera, moment
from rigtwin.lab.errors import BadInput
from rigtwin.measure.media import video_file
from rigtwin.review import frames as subject
from rigtwin.review.frames import Pictures

COUNT = 200


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """The halves of frame k have grey levels that say its tens and its ones."""
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "4", "x264-params": "keyint=50:mbtree=0"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(COUNT):
            grey = np.full((48, 64, 3), 40 + 10 * (k // 10), dtype=np.uint8)
            grey[:, 32:] = 40 + 10 * (k % 10)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="bgr24")))
        container.mux(stream.encode())
    return path


@pytest.fixture
def pictures():
    made = Pictures()
    yield made
    made.close()


def level(data):
    return float(cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE).mean())


def number_on(data):
    grey = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE).astype(float)
    tens, ones = (round((float(half.mean()) - 40) / 10) for half in (grey[:, 4:28], grey[:, 36:60]))
    return 10 * tens + ones


@pytest.mark.parametrize("kept", [10**9, 1])  # decoded pictures of all of the clip, or of none
def test_frames_are_right_in_any_order(clip, pictures, monkeypatch, kept):
    monkeypatch.setattr(video_file, "KEPT", kept)
    monkeypatch.setattr(subject, "KEPT", 40_000)  # some dozen frames
    for index in (0, 1, 2, 199, 198, 197, 100, 99, 98, 60, 61, 150, 10, 9, 0):
        assert number_on(pictures.picture(clip, Camera(), index, photo=False)[1]) == index


def test_all_of_a_clip_is_shown_whatever_is_measured_of_it(clip, pictures):
    info = pictures.info(clip, Camera(frame_rate=240, start=moment("50f"), region=(0, 0, 20, 20)), photo=False)
    assert (info.width, info.height, len(info.times)) == (64, 48, COUNT)
    assert info.times[120] == pytest.approx(0.5)


def test_a_frame_behind_the_end_is_refused(clip, pictures):
    with pytest.raises(BadInput, match="has no frame 200; its last one is 199"):
        pictures.picture(clip, Camera(), COUNT, photo=False)


def test_a_large_photo_is_reduced_and_said_with_its_own_size(tmp_path, pictures):
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((300, 4000, 3), 90, dtype=np.uint8))
    info = pictures.info(tmp_path / "photo.png", Camera(), photo=True)
    assert (info.width, info.height, info.times) == (4000, 300, ())
    _, data = pictures.picture(tmp_path / "photo.png", Camera(), 0, photo=True)
    assert cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR).shape == (154, 2048, 3)


def test_a_photo_that_was_replaced_is_read_again(tmp_path, pictures):
    photo = tmp_path / "photo.png"
    for grey in (50, 150):
        cv2.imwrite(str(photo), np.full((40, 60, 3), grey, dtype=np.uint8))
        os.utime(photo, (grey, grey))
        assert level(pictures.picture(photo, Camera(), 0, photo=True)[1]) == pytest.approx(grey, abs=1)


def test_every_frame_comes_that_is_asked_for_at_the_same_time(clip, pictures, monkeypatch):
    monkeypatch.setattr(video_file, "KEPT", 1)
    asked = [150, 3, 90, 4, 199, 60, 0, 120] * 3
    with ThreadPoolExecutor(len(asked)) as pool:
        found = pool.map(lambda index: number_on(pictures.picture(clip, Camera(), index, photo=False)[1]), asked)
        assert list(found) == asked


def test_a_frame_near_the_one_that_is_asked_for_comes_while_that_is_not_there(clip, pictures, monkeypatch):
    monkeypatch.setattr(subject, "SOON", 0.0)
    pictures.picture(clip, Camera(), 0, photo=False)
    shown, data = pictures.picture(clip, Camera(), 199, photo=False, near=True)
    assert number_on(data) == shown
    assert pictures.picture(clip, Camera(), 199, photo=False)[0] == 199
    assert pictures.picture(clip, Camera(), 199, photo=False, near=True)[0] == 199


def test_a_frame_that_cannot_be_decoded_leaves_the_others_as_they_are(tmp_path, pictures, monkeypatch):
    monkeypatch.setattr(subject, "KEPT", 20_000)  # some ten frames: most are decoded when they are asked for
    for k in range(40):
        grey = np.full((48, 64, 3), 40 + 10 * (k // 10), dtype=np.uint8)
        grey[:, 32:] = 40 + 10 * (k % 10)
        cv2.imwrite(str(tmp_path / f"{k:03}.png"), grey)
    damaged = tmp_path / "020.png"
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[:40])
    camera = Camera(frame_rate=240)
    for index in (0, 19, 21, 39, 21, 19, 0):
        assert number_on(pictures.picture(tmp_path, camera, index, photo=False)[1]) == index
    with pytest.raises(BadInput, match="frame 20 cannot be decoded"):
        pictures.picture(tmp_path, camera, 20, photo=False)
    assert number_on(pictures.picture(tmp_path, camera, 30, photo=False)[1]) == 30
    damaged.write_bytes(whole)
    assert number_on(pictures.picture(tmp_path, camera, 20, photo=False)[1]) == 20
