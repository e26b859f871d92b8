"""Films are opened as files, whatever their name; play lists and damaged ones are refused in one sentence."""

from __future__ import annotations

import errno
import socket
import struct
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import tifffile

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput, UnreadableMedia
from rigtwin.measure.media import container as containers
from rigtwin.measure.media import photo as photos
from rigtwin.measure.media.container import open_container
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.media.sound import read_sound
from rigtwin.measure.media.video import open_video


def film(path: Path, *, title: str = "", codec: str = "libx264") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    made = path.absolute().with_name("made.mkv")
    with av.open(str(made), "w") as container:
        if title:
            container.metadata["title"] = title
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        for grey in range(12):
            picture = np.full((32, 32, 3), 10 * grey, np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return made.rename(path)


def test_a_film_whose_name_looks_like_a_protocol_is_a_file(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("10:30.mkv", "tcp:127.0.0.1:9.mkv", "http:/127.0.0.1/x.mkv", "concat:a|b.mkv", "%03d.mkv"):
        clip = film(Path(name))
        assert len(open_video(clip, Camera()).times) == 12, name


def test_no_connection_is_opened_for_a_missing_film_named_as_an_address(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.2)
        port = server.getsockname()[1]
        for name in (f"http:/127.0.0.1:{port}/x.mp4", f"tcp:127.0.0.1:{port}"):
            with pytest.raises(UnreadableMedia, match="no such file"):
                open_video(Path(name), Camera())
        with pytest.raises(TimeoutError):
            server.accept()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("twice.ffconcat", "ffconcat version 1.0\nfile clip.mkv\nfile clip.mkv\n"),
        ("twice.mp4", "ffconcat version 1.0\nfile clip.mkv\nfile clip.mkv\n"),
        ("live.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nclip.mkv\n"),
        ("list.mpd", '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011"></MPD>'),
    ],
)
def test_a_play_list_is_no_clip(tmp_path, name, text) -> None:
    film(tmp_path / "clip.mkv")
    (tmp_path / name).write_text(text)
    with pytest.raises(UnreadableMedia, match="names other files"):
        open_video(tmp_path / name, Camera())


def test_a_format_that_reads_other_files_is_refused_even_where_its_beginning_is_not_recognised(tmp_path) -> None:
    film(tmp_path / "clip.mkv")
    (tmp_path / "list.ffconcat").write_text(" " * 600 + "\nffconcat version 1.0\nfile clip.mkv\n")
    with pytest.raises((UnreadableMedia, av.FFmpegError)), open_container(tmp_path / "list.ffconcat"):
        pass


def test_metadata_that_are_no_text_do_not_matter(tmp_path) -> None:
    clip = film(tmp_path / "clip.mkv", title="XXXXXXXX")
    clip.write_bytes(clip.read_bytes().replace(b"XXXXXXXX", b"\x80\xff\x80\xffabcd"))
    assert len(open_video(clip, Camera()).times) == 12


def test_a_film_without_a_decoder_is_refused(tmp_path) -> None:
    clip = film(tmp_path / "clip.mkv")
    clip.write_bytes(clip.read_bytes().replace(b"V_MPEG4/ISO/AVC", b"V_MPEG4/ISO/XYZ"))
    with pytest.raises(UnreadableMedia, match="no decoder"):
        open_video(clip, Camera())
    with pytest.raises(UnreadableMedia, match="no sound track"):
        read_sound(clip)


def test_a_pipe_is_no_film(tmp_path) -> None:
    import os

    os.mkfifo(tmp_path / "clip.mp4")
    with pytest.raises(UnreadableMedia, match="a pipe or a device"):
        open_video(tmp_path / "clip.mp4", Camera())


def test_missing_memory_is_not_taken_for_damage(tmp_path, monkeypatch) -> None:
    clip = film(tmp_path / "clip.mkv")
    video = open_video(clip, Camera())

    def short_of_memory(*_: object) -> object:
        raise av.error.MemoryError(12, "Cannot allocate memory")

    monkeypatch.setattr(type(video.source), "pictures", short_of_memory)
    with pytest.raises(MemoryError):
        list(video.frames())


def test_the_first_bytes_of_a_stack_damaged_in_any_way_end_in_a_refusal_or_a_film(tmp_path) -> None:
    good = tmp_path / "good.tif"
    tifffile.imwrite(good, np.random.default_rng(1).integers(0, 255, (4, 24, 24), np.uint8), photometric="minisblack")
    stored = good.read_bytes()
    random, refused = np.random.default_rng(2), 0
    for _ in range(150):
        damaged = bytearray(stored)
        for place in random.integers(4, 220, 3):
            damaged[place] = int(random.integers(0, 256))
        path = tmp_path / "damaged.tif"
        path.write_bytes(damaged)
        try:
            video = open_video(path, Camera(frame_rate=100.0))
            list(video.frames())
        except UnreadableMedia:
            refused += 1
    assert refused > 20


def huge_tiff(path: Path, side: int) -> Path:
    entries = [(256, 4, side), (257, 4, side), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1),
               (278, 4, side), (279, 4, 1000)]  # fmt: skip
    table = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", t, k, 1, v) for t, k, v in entries)
    path.write_bytes(b"II*\0" + struct.pack("<I", 8) + table + bytes(1100))
    return path


def test_pixels_beyond_any_camera_are_refused_before_memory_is_taken(tmp_path) -> None:
    path = huge_tiff(tmp_path / "huge.tif", 60000)
    with pytest.raises(UnreadableMedia, match="60000 x 60000 px"):
        open_video(path, Camera(frame_rate=100.0))
    with pytest.raises(UnreadableMedia, match="60000 x 60000 px"):
        read_photo(path)
    stored = bytearray(cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes())
    stored[16:24] = struct.pack(">II", 30000, 30000)
    import zlib

    stored[29:33] = struct.pack(">I", zlib.crc32(bytes(stored[12:29])))
    (tmp_path / "huge.png").write_bytes(stored)
    with pytest.raises(UnreadableMedia, match="30000 x 30000 px"):
        read_photo(tmp_path / "huge.png")


PEAK = """
import resource, sys
from pathlib import Path
from rigtwin.lab.errors import UnreadableMedia
from rigtwin.measure.media.photo import read_photo
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    read_photo(Path(sys.argv[1]))
except UnreadableMedia:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="peak memory in kB")
def test_a_photo_that_states_more_data_than_it_has_is_refused_before_memory_is_taken(tmp_path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (64, 64), dtype=np.uint8)
    stored = bytearray(cv2.imencode(".png", noise)[1].tobytes())
    data = stored.index(b"IDAT") - 4
    stored[data : data + 4] = struct.pack(">I", 2**31 - 1)
    (tmp_path / "view.png").write_bytes(stored[:-600])
    words = [sys.executable, "-c", PEAK, str(tmp_path / "view.png")]
    grown = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    assert int(grown) < 500_000  # [kB]


def test_a_photo_that_a_telephone_did_not_finish_is_refused(tmp_path) -> None:
    import pillow_heif
    from PIL import Image

    pillow_heif.register_heif_opener()
    path = tmp_path / "photo.heic"
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8)).save(path)
    whole = path.read_bytes()
    assert photos.read_photo(path)[0].shape == (64, 64, 3)
    for share in (0.2, 0.5, 0.8, 0.95):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(UnreadableMedia):
            read_photo(path)


@pytest.mark.parametrize("rate", ["nan", "inf", "0", "-5"])
def test_a_recording_without_a_possible_rate_is_refused(tmp_path, rate) -> None:
    header = f"Record Rate(fps) : {rate}\nImage Width : 8\nImage Height : 8\nTotal Frame : 4\nColor Bit : 8\n"
    (tmp_path / "clip.cih").write_text(header)
    (tmp_path / "clip.mraw").write_bytes(bytes(256))
    with pytest.raises(UnreadableMedia, match="pictures per second"):
        open_video(tmp_path / "clip.cih", Camera())


@pytest.mark.parametrize("number", [errno.ENOMEM, errno.EAGAIN])
def test_what_a_decoder_lacks_is_memory_and_no_damage(tmp_path, monkeypatch, number) -> None:
    monkeypatch.setattr(containers, "memory_is_there", lambda: False)
    clip = film(tmp_path / "clip.mkv")
    kind = {errno.ENOMEM: av.error.MemoryError, errno.EAGAIN: av.error.BlockingIOError}[number]

    def fail() -> None:
        with open_container(clip):
            raise kind(number, "no room")

    with pytest.raises(MemoryError):
        fail()


def test_a_film_that_asks_for_more_memory_than_any_needs_is_damaged(tmp_path) -> None:
    clip = film(tmp_path / "clip.mkv")

    def fail() -> None:
        with open_container(clip):
            raise av.error.MemoryError(errno.ENOMEM, "no room")

    with pytest.raises(UnreadableMedia, match="more than 2 GB"):
        fail()


def test_a_photo_of_which_a_part_is_damaged_is_refused(tmp_path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (200, 300), dtype=np.uint8)
    whole = cv2.imencode(".jpg", cv2.GaussianBlur(noise, (0, 0), 3))[1].tobytes()
    half = len(whole) // 2
    for number, stored in enumerate(
        (whole[:half] + bytes(400) + whole[half + 400 :], whole[:half] + whole[half + 900 :], whole)
    ):
        path = tmp_path / f"{number}.jpg"
        path.write_bytes(stored)
        if stored == whole:
            assert read_photo(path)[0].shape == (200, 300, 3)
        else:
            with pytest.raises(UnreadableMedia, match="a part of its picture data is damaged"):
                read_photo(path)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_decoders_write_nothing_of_their_own_on_a_damaged_photo(tmp_path, capfd, ending) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (64, 64), dtype=np.uint8)
    stored = bytearray(cv2.imencode(ending, noise)[1].tobytes())
    stored[-600:-590] = bytes(10)
    (tmp_path / f"view{ending}").write_bytes(stored)
    with suppress(UnreadableMedia):
        read_photo(tmp_path / f"view{ending}")
    assert capfd.readouterr().err == ""


def test_a_stated_base_with_an_end_far_outside_of_the_photo_is_refused(tmp_path):
    path = tmp_path / "heap.png"
    cv2.imwrite(str(path), np.zeros((300, 400, 3), np.uint8))
    far = Camera(base=((1e300, 120.0), (200.0, 120.0)))
    with pytest.raises(BadInput, match=r"--base names a point at 1e\+300,120, outside the picture of 400 x 300 px"):
        read_photo(path, far)
