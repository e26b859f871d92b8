"""With a calibration board lengths in its plane are correct for any lens distortion and tilt."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from rigtwin.cli import run
from rigtwin.lab.camera import Board, Camera, board, plumb_line
from rigtwin.lab.errors import BadInput, BadQuantity
from rigtwin.measure.geometry.calibration_board import read_board, straightened
from rigtwin.measure.media.undistort import project, straight
from rigtwin.measure.media.video import open_video

SIZE = (640, 480)  # [px]
SQUARE = 0.010  # [m]
PIXEL = 0.25e-3  # [m], about one pixel


class Bench:
    """A camera with oblique view of a plane and radial distortion."""

    def __init__(self, tilt=12.0, pan=-8.0, bend=-0.06, roll=2.0):
        tilt, pan, roll = map(math.radians, (tilt, pan, roll))
        turn = cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0] @ cv2.Rodrigues(np.array([tilt, pan, 0.0]))[0]
        focal, away = 900.0, 900.0 * PIXEL
        lens = np.array([[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1]])
        self.plane = lens @ np.column_stack([turn[:, :2], [0.0, 0.0, away]])
        self.bend = bend

    def in_plane(self):
        """Points of the plane [m] seen by each pixel, 2 x 2 rays per pixel, shape (2h, 2w, 2)."""
        down, across = (np.mgrid[: 2 * SIZE[1], : 2 * SIZE[0]] - 0.5) / 2
        middle = (np.array(SIZE) - 1) / 2
        bent = (np.stack([across, down], axis=-1) - middle) / (math.hypot(*SIZE) / 2)
        flat = bent.copy()
        for _ in range(6):  # inverse of the distortion by iteration
            flat = bent / (1 + self.bend * np.sum(flat * flat, axis=-1, keepdims=True))
        pixels = flat * (math.hypot(*SIZE) / 2) + middle
        points = np.concatenate([pixels, np.ones((*pixels.shape[:2], 1))], axis=-1) @ np.linalg.inv(self.plane).T
        return points[..., :2] / points[..., 2:]

    def photo(self, brightness):
        """A picture of the plane; `brightness` takes metres, shape (h, w, 2), and gives 0 to 255."""
        fine = brightness(self.in_plane()).astype(np.float32)
        return cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA).round().astype(np.uint8)


def checkers(columns, rows):
    def brightness(points):
        place = points / SQUARE + np.array([columns, rows]) / 2
        inside = np.all((place > 0) & (place < [columns, rows]), axis=-1)
        edges = np.clip(20 * np.sin(np.pi * place), -1, 1)  # slightly soft, so that four rays per pixel are enough
        return np.where(inside, 125 - 95 * edges[..., 0] * edges[..., 1], 220.0)

    return brightness


def printed(picture, width):
    """A picture of width `width` [m] on the plane, white around it."""
    scale = picture.shape[1] / width

    def brightness(points):
        at = (points * scale + np.array(picture.shape[::-1]) / 2).astype(np.float32)
        return cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=230)

    return brightness


def film(folder, bench, places, radius):
    """Numbered stills of a dark disc at `places` [m] in the plane."""
    folder.mkdir()
    grid = bench.in_plane()
    for number, place in enumerate(places):
        away = np.hypot(*(grid - place).transpose(2, 0, 1))
        shade = np.where(away < radius, 40.0, 200.0).astype(np.float32)
        cv2.imwrite(str(folder / f"{number:04d}.png"), cv2.resize(shade, SIZE, interpolation=cv2.INTER_AREA))


@pytest.mark.slow
@settings(max_examples=5, deadline=None, derandomize=True, phases=[Phase.generate])
@given(st.floats(-15, 15), st.floats(-15, 15), st.floats(-0.1, 0.05), st.floats(-3, 3))
def test_squares_of_a_rectified_board_have_equal_size(tmp_path_factory, tilt, pan, bend, roll):
    file = tmp_path_factory.mktemp("board") / "board.png"
    photo = Bench(tilt, pan, bend, roll).photo(checkers(13, 9))
    cv2.imwrite(str(file), photo)
    lens = read_board(Board("checkerboard", 13, 9, SQUARE, None, file))
    found, corners = cv2.findChessboardCornersSB(straight(photo, lens), (12, 8), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    corners = corners.reshape(8, 12, 2) * lens.scale
    for sides in (np.diff(corners, axis=0), np.diff(corners, axis=1)):
        assert np.hypot(*sides.transpose(2, 0, 1)) == pytest.approx(SQUARE, rel=0.006)  # 0.2 px of 40
    assert np.hypot(*(corners[-1, -1] - corners[0, 0])) == pytest.approx(math.hypot(11, 7) * SQUARE, rel=5e-4)
    assert lens.uncertainty < 2e-3
    assert lens.residual < 0.3


def test_a_small_board_in_the_centre_does_not_distort_the_border(tmp_path):
    bench = Bench(tilt=5, pan=-5, bend=-0.03)
    cv2.imwrite(str(tmp_path / "board.png"), bench.photo(checkers(9, 6)))
    lens = read_board(board(f"checkerboard 9x6 10mm {tmp_path / 'board.png'}"))
    looks_at = bench.in_plane().astype(np.float32)
    for x, y in ((50, 50), (590, 50), (590, 430)):
        ends = project(np.array([[x, y], [x + 20.0, y]]), np.array(lens.plane), lens.bend, SIZE)
        at = (2 * ends + 0.5).astype(np.float32)[None]
        start, end = cv2.remap(looks_at, at[..., 0], at[..., 1], cv2.INTER_LINEAR)[0]
        assert np.hypot(*(end - start)) == pytest.approx(20 * lens.scale, rel=0.005)


@pytest.mark.parametrize("legacy", [False, True])
def test_a_charuco_board_may_be_partly_hidden(tmp_path, legacy):
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    drawn = cv2.aruco.CharucoBoard((9, 6), 0.012, 0.009, book)
    drawn.setLegacyPattern(legacy)
    picture = drawn.generateImage((1080, 720))
    picture[:, :250] = 200  # a hand in front of it
    file = tmp_path / "board.png"
    cv2.imwrite(str(file), Bench(tilt=0, pan=0).photo(printed(picture, 9 * 0.012)))
    lens = read_board(board(f"charuco 9x6 12mm/9mm {file}"))
    assert lens.scale == pytest.approx(PIXEL, rel=0.01)
    assert lens.residual < 0.3


def test_one_marker_gives_a_scale_with_correct_uncertainty(tmp_path):
    picture = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 600)
    file = tmp_path / "board.png"
    bench = Bench(tilt=0, pan=0, bend=0.0)
    cv2.imwrite(str(file), bench.photo(printed(picture, 0.030)))
    lens = read_board(board(f"aruco 30mm {file}"))
    assert abs(lens.scale / PIXEL - 1) < 3 * lens.uncertainty
    assert 1e-4 < lens.uncertainty < 0.01


def test_a_fall_seen_obliquely_gives_the_same_gravity_as_seen_perpendicularly(tmp_path):
    bench = Bench()
    cv2.imwrite(str(tmp_path / "board.png"), bench.photo(checkers(13, 9)))
    falls = np.column_stack([np.full(12, 0.02), -0.05 + 0.5 * 9.81 * (np.arange(12) / 80) ** 2])
    film(tmp_path / "clip", bench, falls, 0.004)
    camera = straightened(Camera(frame_rate=80.0, board=board(f"checkerboard 13x9 10mm {tmp_path / 'board.png'}")))

    def gravity(eye, scale):
        y = []
        for frame in open_video(tmp_path / "clip", eye).frames():
            spot = cv2.moments((frame.grey < 120).astype(np.uint8), binaryImage=True)
            y.append(spot["m01"] / spot["m00"])
        return 2 * np.polyfit(np.arange(12) / 80, np.array(y) * scale, 2)[0] / math.cos(math.radians(2.0))

    assert gravity(camera, camera.given_scale) == pytest.approx(9.81, rel=0.005)
    assert abs(gravity(Camera(frame_rate=80.0), camera.given_scale) / 9.81 - 1) > 0.01


def test_pictures_of_another_size_than_the_board_are_refused(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "board.png"), Bench().photo(checkers(13, 9)))
    cv2.imwrite(str(tmp_path / "heap.png"), np.zeros((100, 120), np.uint8))
    text = f"checkerboard 13x9 10mm {tmp_path / 'board.png'}"
    assert run(["measure", "pile", str(tmp_path / "heap.png"), "--board", text]) == 2
    message = capsys.readouterr().err
    assert "heap.png" in message
    assert "same camera, lens and resolution" in message


@pytest.mark.parametrize("kind", ["checkerboard 9x6 10mm", "charuco 9x6 12mm/9mm", "aruco 30mm"])
def test_a_photo_without_the_board_is_refused_in_one_line(tmp_path, capsys, kind):
    file = tmp_path / "plain.png"
    cv2.imwrite(str(file), np.full((480, 640), 128, np.uint8))
    cv2.imwrite(str(tmp_path / "clip.png"), np.full((480, 640), 128, np.uint8))
    assert run(["measure", "pile", str(tmp_path / "clip.png"), "--board", f"{kind} {file}"]) == 2
    message = capsys.readouterr().err
    assert "plain.png" in message
    assert message.count("\n") == 1


@pytest.mark.parametrize(
    "text",
    [
        "",
        "checkerboard 9x6 board.jpg",
        "checkerboard 10mm board.jpg",
        "charuco 9x6 10mm board.jpg",
        "charuco 9x6 10mm/12mm board.jpg",
        "aruco 9x6 10mm board.jpg",
        "checkerboard 2x6 10mm board.jpg",
        "checkerboard 9x6 -10mm board.jpg",
        "checkerboard 9x6 10kg board.jpg",
        "checkerboard 9x6 10 board.jpg",
    ],
)
def test_an_invalid_board_is_refused(text):
    with pytest.raises(BadQuantity):
        board(text)


def test_board_and_scale_together_are_refused():
    with pytest.raises(BadInput, match="leave one"):
        Camera(scale=1e-4, board=board("aruco 30mm board.jpg"))


@given(st.floats(-40, 40), st.floats(50, 900), st.booleans())
def test_a_plumb_line_gives_the_roll(degrees, length, upside_down):
    lean = math.radians(degrees)
    ends = [(300 + length * math.sin(lean), 100.0), (300.0, 100 + length * math.cos(lean))]  # top, bottom
    (x1, y1), (x2, y2) = reversed(ends) if upside_down else ends
    assert plumb_line(f"{x1!r},{y1!r},{x2!r},{y2!r}") == pytest.approx(lean, abs=1e-9)
