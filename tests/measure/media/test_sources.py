"""Clips other than ordinary video files: stills, stacks, Photron recordings, interlaced videos; photos from phones."""

import struct
import subprocess
import sys
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
import tifffile

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput, UnreadableMedia
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.media.video import open_video

RATE = Camera(frame_rate=500.0)
CIHX = """binary\x00 before <cih><recordInfo><recordRate>1000</recordRate></recordInfo><frameInfo><totalFrame>{count}
</totalFrame></frameInfo><imageDataInfo><resolution><width>16</width><height>6</height></resolution><colorInfo>
<bit>{bits}</bit></colorInfo><effectiveBit><depth>{used}</depth></effectiveBit></imageDataInfo></cih> after"""
CIH = """#Camera Information Header
Record Rate(fps) : 1000
Total Frame : {count}
Image Width : 16
Image Height : 6
Color Bit : {bits}
EffectiveBit Depth : {used}
"""


def greys(clip, camera=RATE):
    return [frame.grey for frame in open_video(clip, camera).frames()]


def ramp(k, top):
    """A brightness ramp from 0 to below `top` that moves with the frame."""
    return ((np.arange(96).reshape(6, 16) + 7 * k) % 100) * (top / 100)


def test_numbered_stills_come_in_the_order_of_their_numbers(tmp_path):
    for k in range(12):
        cv2.imwrite(str(tmp_path / f"img{k}.png"), np.full((6, 16), 10 * k, np.uint8))
    video = open_video(tmp_path, RATE)
    assert [int(frame.grey[0, 0]) for frame in video.frames()] == [10 * k for k in range(12)]
    assert video.times == pytest.approx(np.arange(12) / 500)
    assert video.warnings == ()
    assert next(video.frames()).colour.shape == (6, 16, 3)


def test_stills_without_a_frame_rate_are_refused(tmp_path):
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((6, 16), np.uint8))
    with pytest.raises(BadInput, match="--frame-rate"):
        open_video(tmp_path, Camera())


def test_stills_of_two_sizes_are_refused(tmp_path):
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((6, 16 + k // 3), np.uint8))
    with pytest.raises(UnreadableMedia, match=r"3\.png.*17 x 6"):
        greys(tmp_path)


def test_twelve_bits_in_sixteen_are_not_read_as_black(tmp_path):
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), ramp(k, 4095).astype(np.uint16))
    video = open_video(tmp_path, RATE)
    assert any("12 bits" in warning for warning in video.warnings)
    for k, frame in enumerate(video.frames()):
        assert np.abs(frame.grey - ramp(k, 255)).max() <= 1.5


def test_a_dim_first_picture_does_not_make_the_others_white(tmp_path):
    dim, bright = np.full((4, 20, 30), 40, np.uint16), np.linspace(0, 4095, 4 * 20 * 30, dtype=np.uint16)
    tifffile.imwrite(tmp_path / "dim.tif", np.concatenate([dim, bright.reshape(4, 20, 30)]))
    np.testing.assert_array_equal(greys(tmp_path / "dim.tif")[-1], bright.reshape(4, 20, 30)[-1] >> 4)


def test_twelve_bits_of_a_grey_video_and_of_a_photo_fill_the_grey_levels(tmp_path):
    deep = np.linspace(0, 4095, 40 * 60, dtype=np.uint16).reshape(40, 60)
    with av.open(str(tmp_path / "deep.mkv"), "w") as out:
        stream = out.add_stream("ffv1", rate=240, width=60, height=40, pix_fmt="gray16le")
        for _ in range(5):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(deep, format="gray16le")))
        out.mux(stream.encode())
    video = open_video(tmp_path / "deep.mkv", RATE)
    assert any("12 bits" in warning for warning in video.warnings)
    frame = next(iter(video.frames()))
    np.testing.assert_array_equal(frame.grey, deep >> 4)
    np.testing.assert_array_equal(frame.colour[..., 1], deep >> 4)
    cv2.imwrite(str(tmp_path / "deep.png"), deep)
    photo, odd = read_photo(tmp_path / "deep.png")
    np.testing.assert_array_equal(photo[..., 0], deep >> 4)
    assert "12-bit photo" in odd[0]
    assert "16 times brighter" in odd[0]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_stack_of_stills_is_a_clip(tmp_path, dtype):
    top = np.iinfo(dtype).max
    tifffile.imwrite(tmp_path / "clip.tif", np.stack([ramp(k, top) for k in range(5)]).astype(dtype))
    for k, grey in enumerate(greys(tmp_path / "clip.tif")):
        assert np.abs(grey - ramp(k, 255)).max() <= 2.0


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("header", [CIHX, CIH])
def test_a_photron_recording_gives_its_pictures_and_its_rate(tmp_path, bits, header):
    used = min(bits, 12)
    pictures = [ramp(k, 2**used - 1).astype(np.uint16) for k in range(5)]
    data = b""
    for picture in pictures:
        if bits == 8:
            data += picture.astype(np.uint8).tobytes()
        elif bits == 16:
            data += picture.astype("<u2").tobytes()
        else:
            first, second = picture.reshape(-1, 2).T
            packed = np.stack([first >> 4, ((first & 15) << 4) | (second >> 8), second & 255], axis=1)
            data += packed.astype(np.uint8).tobytes()
    (tmp_path / "clip.mraw").write_bytes(data)
    name = "clip.cihx" if header is CIHX else "clip.cih"
    (tmp_path / name).write_text(header.format(count=5, bits=bits, used=used))
    video = open_video(tmp_path / name, Camera())
    assert video.frame_rate == 1000
    assert [frame.index for frame in video.frames()] == list(range(5))
    for picture, frame in zip(pictures, video.frames(), strict=True):
        assert np.array_equal(frame.grey, picture >> (used - 8))


def test_a_truncated_photron_recording_gives_the_number_of_pictures_left(tmp_path):
    (tmp_path / "clip.mraw").write_bytes(bytes(16 * 6 * 4 + 11))
    (tmp_path / "clip.cih").write_text(CIH.format(count=9, bits=8, used=8))
    video = open_video(tmp_path / "clip.mraw", Camera())
    assert len(video.times) == 4
    assert any("4 of 9" in warning for warning in video.warnings)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"clip.mraw": b"x" * 960}, "header is missing"),
        ({"clip.mraw": b"x" * 960, "clip.cih": b"nothing here"}, "cannot be read from it"),
        ({"clip.mraw": b"x" * 960, "clip.cih": CIH.format(count=9, bits=10, used=10).encode()}, "10 bits"),
    ],
)
def test_an_unreadable_photron_recording_is_refused_by_name(tmp_path, files, words):
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UnreadableMedia, match=words):
        open_video(tmp_path / "clip.mraw", Camera())


def film(path, pictures, *, layout=None, **options):
    with av.open(str(path), "w", options=layout or {}) as container:
        stream = container.add_stream("libx264", rate=50, options={"x264-params": "mbtree=0"} | options)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(("squeeze", "size"), [("4/3", (64, 48)), ("3/4", (48, 48)), ("1/1", (48, 36))])
def test_a_video_with_non_square_pixels_is_resized_as_in_a_player(tmp_path, squeeze, size):
    """A disc stored with non-square pixels comes out round."""
    across, down = (int(side) for side in squeeze.split("/"))
    wide, high = (size[0] * down // across, size[1]) if across > down else (size[0], size[1] * across // down)
    big = np.full((size[1] * 8, size[0] * 8, 3), 60, np.uint8)
    cv2.circle(big, (size[0] * 4, size[1] * 4), 8 * 12, (200, 200, 200), cv2.FILLED)
    stored = cv2.resize(big, (wide, high), interpolation=cv2.INTER_AREA)
    with av.open(str(tmp_path / "clip.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=50)
        stream.width, stream.height, stream.pix_fmt = wide, high, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(squeeze)
        for _ in range(6):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(stored, format="bgr24")))
        container.mux(stream.encode())
    video = open_video(tmp_path / "clip.mp4", Camera(frame_rate=50.0))
    assert (video.width, video.height) == size
    frame = next(video.frames())
    for picture in (frame.grey, frame.colour[..., 1]):
        rows, columns = np.nonzero(picture > 130)
        assert (np.ptp(rows), np.ptp(columns)) == pytest.approx((23, 23), abs=2)
    assert any("times as wide as high" in line for line in video.warnings) == (squeeze != "1/1")


@pytest.mark.parametrize("dtype", [np.float32, np.int16, np.uint32])
def test_a_stack_of_other_types_than_8_and_16_bits_is_refused(tmp_path, dtype):
    tifffile.imwrite(tmp_path / "clip.tif", np.stack([ramp(k, 4000) for k in range(5)]).astype(dtype))
    with pytest.raises(UnreadableMedia, match="save it with 8 or 16 bits"):
        open_video(tmp_path / "clip.tif", RATE)


@pytest.mark.parametrize("left", [0.6, 0.9])
@pytest.mark.parametrize("packed", ["zlib", None])
def test_a_truncated_stack_gives_the_number_of_pictures_left_or_the_place_of_damage(tmp_path, left, packed):
    whole = tmp_path / "whole.tif"
    noise = np.random.default_rng(5).integers(0, 255, (10, 40, 50), dtype=np.uint8)
    tifffile.imwrite(whole, noise, compression=packed)
    content = whole.read_bytes()
    cut = tmp_path / "cut.tif"
    cut.write_bytes(content[: round(left * len(content))])
    try:
        video = open_video(cut, RATE)
        message = video.broken_off
        assert len(list(video.frames())) < 10
    except UnreadableMedia as broken:
        message = str(broken)
    assert message
    assert "\n" not in message


def plain(count):
    return [np.full((48, 64, 3), 5 * k, dtype=np.uint8) for k in range(count)]


@pytest.mark.parametrize("name", ["clip.mp4", "clip.avi"])  # AVI packets carry no presentation time
def test_an_interlaced_video_is_detected(tmp_path, name):
    clip = film(tmp_path / name, plain(12), **{"x264-params": "interlaced=1"})
    assert "interlaced" in open_video(clip, Camera(frame_rate=50.0)).spoilt
    assert not open_video(film(tmp_path / f"whole_{name}", plain(12)), Camera(frame_rate=50.0)).spoilt


def test_reordered_pictures_have_their_presentation_times(tmp_path):
    clip = film(tmp_path / "clip.mp4", plain(40), bf="3", b_strategy="0")
    video = open_video(clip, Camera(frame_rate=50.0))
    assert video.times == pytest.approx(np.arange(40) / 50)
    assert np.all(np.diff([frame.grey.mean() for frame in video.frames()]) > 0)


@pytest.mark.parametrize(
    ("name", "layout"),
    [
        ("clip.mkv", {}),
        ("clip.avi", {}),
        ("clip.mp4", {"movflags": "faststart"}),
        ("clip.mp4", {"movflags": "frag_keyframe+empty_moov"}),
    ],
)
def test_a_truncated_video_gives_what_decodes_and_a_warning(tmp_path, name, layout):
    rng = np.random.default_rng(2)
    noise = [rng.integers(0, 255, (48, 64, 3), dtype=np.uint8) for _ in range(30)]
    whole = film(tmp_path / name, noise, layout=layout, bf="0", g="5")
    assert not open_video(whole, RATE).spoilt
    for share in (0.6, 0.9):
        cut = tmp_path / f"cut_{name}"
        cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * share)])
        video = open_video(cut, RATE)
        assert 2 < len(list(video.frames())) == len(video.times) < 30
        assert "broken off" in video.spoilt


@pytest.mark.parametrize("layout", [{}, {"movflags": "faststart"}, {"movflags": "frag_keyframe+empty_moov"}])
@pytest.mark.parametrize("trailer", [b"recorded by a camera of 1080p50.", b"\xff" * 64, bytes(64), b"end"])
def test_data_appended_by_a_camera_does_not_count_as_truncation(tmp_path, layout, trailer):
    clip = film(tmp_path / "clip.mp4", plain(12), layout=layout)
    clip.write_bytes(clip.read_bytes() + trailer)
    assert not open_video(clip, RATE).spoilt


def test_a_riff_length_that_includes_its_header_is_complete(tmp_path):
    clip = film(tmp_path / "clip.avi", plain(12))
    content = clip.read_bytes()
    clip.write_bytes(content[:4] + len(content).to_bytes(4, "little") + content[8:])
    assert not open_video(clip, RATE).spoilt


def test_a_photo_of_a_phone_is_read(tmp_path):
    import pillow_heif
    from PIL import Image

    picture = np.zeros((64, 96, 3), dtype=np.uint8)
    picture[:, 48:, 0] = 200  # red to the right
    pillow_heif.from_pillow(Image.fromarray(picture)).save(tmp_path / "photo.heic", quality=95)
    read, _ = read_photo(tmp_path / "photo.heic")
    assert read.shape == (64, 96, 3)
    assert read[:, 60:, 2].mean() > 150
    assert read[:, :40].mean() < 60


def test_a_damaged_photo_is_refused_in_one_sentence(tmp_path):
    photo = tmp_path / "photo.tif"
    cv2.imwrite(str(photo), np.full((64, 96), 90, np.uint8))
    samples = struct.pack("<HHIHH", 277, 3, 1, 1, 0)  # tag of the samples per pixel, one short number
    content = photo.read_bytes()
    assert content.count(samples) == 1
    photo.write_bytes(content.replace(samples, struct.pack("<HHIHH", 277, 3, 1, 20726, 0)))
    # a process of its own: the tests handle the log of every library
    command = [sys.executable, "-m", "rigtwin", "measure", "packing", str(photo), "--cylinder-diameter", "50mm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith(f"rigtwin: {photo}: ")


@pytest.mark.parametrize("size", [1, 2])
def test_a_clip_of_a_few_pixels_is_refused(tmp_path, size):
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((size, size), 40 * k, np.uint8))
    with pytest.raises(UnreadableMedia, match=f"only {size} x {size} px"):
        open_video(tmp_path, RATE)


def test_the_message_for_a_folder_of_videos_names_one_of_them(tmp_path):
    for name in ("r01.mp4", "r02.mp4"):
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(UnreadableMedia, match=r"give one of its 2 videos, e\.g\. .*r01\.mp4"):
        open_video(tmp_path, Camera(frame_rate=30.0))


def test_a_video_without_its_end_is_reported_as_broken_off(tmp_path):
    whole, part = tmp_path / "whole.mp4", tmp_path / "part.mp4"
    with av.open(str(whole), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"x264-params": "mbtree=0"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(20):
            picture = np.full((48, 64, 3), 10 * k, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    content = whole.read_bytes()
    part.write_bytes(content[: content.index(b"moov") - 8])
    with pytest.raises(UnreadableMedia, match=r"^[^;]*\(its end [^;]* was broken off\); copy it again\.$"):
        open_video(part, Camera(frame_rate=30.0))
    part.write_bytes(b"no video at all, but some text")
    with pytest.raises(UnreadableMedia, match="video player"):
        open_video(part, Camera(frame_rate=30.0))


def cine(shots):
    """A Phantom recording of 8-bit grey pictures, stored from the lowest row upwards."""
    high, wide = shots[0].shape
    setup = bytearray(0x1700)
    struct.pack_into("<2sH", setup, 0x8C, b"ST", len(setup))
    struct.pack_into("<I", setup, 0x300, 500)  # frames per second
    first = 84 + len(setup) + 8 * len(shots)
    head = (b"CI", 44, 0, 1, 0, len(shots), 0, len(shots), 44, 84, 84 + len(setup), 0, 0)
    bitmap = (40, wide, high, 1, 8, 0, wide * high, 0, 0, 0, 0)
    places = [first + k * (8 + wide * high) for k in range(len(shots))]
    stored = b"".join(struct.pack("<II", 8, wide * high) + shot[::-1].tobytes() for shot in shots)
    described = struct.pack("<2sHHHiIiIIIIII", *head) + struct.pack("<IiiHHIIiiII", *bitmap)
    return described + bytes(setup) + struct.pack(f"<{len(places)}Q", *places) + stored


def test_a_phantom_recording_of_grey_pictures_stands_upright(tmp_path):
    shots = [ramp(k, 200).astype(np.uint8) for k in range(5)]
    (tmp_path / "clip.cine").write_bytes(cine(shots))
    video = open_video(tmp_path / "clip.cine", Camera())
    assert video.times == pytest.approx(np.arange(5) / 500)
    assert all(np.array_equal(frame.grey, shot) for frame, shot in zip(video.frames(), shots, strict=True))


def test_a_film_whose_pictures_change_their_size_is_refused(tmp_path):
    pictures = [np.zeros((24, 32 if k < 4 else 48), np.uint8) for k in range(8)]
    stored = b"".join(cv2.imencode(".jpg", picture)[1].tobytes() for picture in pictures)
    (tmp_path / "clip.mjpeg").write_bytes(stored)
    with pytest.raises(UnreadableMedia, match="a picture is 48 x 24 px and the first one 32 x 24 px"):
        greys(tmp_path / "clip.mjpeg")
