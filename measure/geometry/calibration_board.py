"""Calibrate lens distortion, perspective and scale with a board photographed in the plane of motion.

A homography followed by radial distortion maps the plane to the picture. Both are fitted to the corners of the board;
focal length and camera position are not needed. A rectified picture shows this plane (and only this plane) as an
ideal camera with perpendicular view: all pixels have the same size in metres.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Board, Camera, Lens
from rigtwin.lab.errors import BadInput
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.media.undistort import project

DICTIONARIES = (
    cv2.aruco.DICT_4X4_1000,
    cv2.aruco.DICT_5X5_1000,
    cv2.aruco.DICT_6X6_1000,
    cv2.aruco.DICT_7X7_1000,
    cv2.aruco.DICT_ARUCO_ORIGINAL,
    cv2.aruco.DICT_APRILTAG_36h11,
)
FEWEST = 6  # minimum number of corners of a partly occluded board
FEWEST_FOR_LENS = 12  # corners; with fewer, distortion and perspective are not separable
FEWEST_FOR_EDGE = 30  # corners; needed for the r^4 term, which matters only near the picture's border
WORST = 1.5  # [px], largest rms residual of the corners; above it the board is bent or was misread
CORNER = 0.1  # [px], smallest standard uncertainty of a corner
USUAL_BEND = (0.1, 0.03)  # prior standard deviations of `Lens.bend`; a board in the centre constrains it only weakly


def straightened(camera: Camera) -> Camera:
    """The camera with `lens` and `scale` from its calibration board; unchanged if it has none.

    Raises `BadInput` if the board is not found in its photo.
    """
    if camera.board is None:
        return camera
    lens = read_board(camera.board)
    return replace(camera, scale=lens.scale, lens=lens)


def read_board(board: Board) -> Lens:
    """Find the board in its photo and fit homography and distortion."""
    photo, _ = read_photo(board.photo)
    grey = np.asarray(cv2.cvtColor(photo, cv2.COLOR_BGR2GRAY), np.uint8)
    on_board, seen = _FINDERS[board.kind](grey, board)
    return _fitted(board, on_board, seen, (grey.shape[1], grey.shape[0]))


# ------------------------------------------------------------------------------------------------------------- corners


def _checkerboard(grey: Image, board: Board) -> tuple[Array, Array]:
    inner = (board.columns - 1, board.rows - 1)
    found, corners = cv2.findChessboardCornersSB(grey, inner, flags=cv2.CALIB_CB_ACCURACY)
    if not found:
        found, corners = cv2.findChessboardCornersSB(grey, inner, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE)
    if not found:
        raise BadInput(
            f"{board.photo}: no complete checkerboard of {board.columns} x {board.rows} squares was found; give the "
            "number of squares, not of inner corners, and show the board with a light margin."
        )
    down, across = np.divmod(np.arange(inner[0] * inner[1]), inner[0])
    return np.column_stack([across, down]) * board.square, _points(corners)


def _charuco(grey: Image, board: Board) -> tuple[Array, Array]:
    book, _ = _markers(grey, board)
    best: tuple[Array, Array] = np.empty((0, 2)), np.empty((0, 2))
    for legacy in (False, True):  # OpenCV before 4.6 drew these boards with the colours swapped
        drawn = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker or 0.0, book)
        drawn.setLegacyPattern(legacy)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(drawn).detectBoard(grey)
        if ids is not None and len(ids) > len(best[0]):
            best = np.asarray(drawn.getChessboardCorners())[ids.ravel(), :2].astype(float), _points(corners)
    if len(best[0]) < FEWEST:
        raise BadInput(
            f"{board.photo}: only {len(best[0])} corners of a ChArUco board of {board.columns} x {board.rows} squares "
            "were found, too few for a fit; check the numbers of squares, focus and lighting."
        )
    return best


def _aruco(grey: Image, board: Board) -> tuple[Array, Array]:
    _, found = _markers(grey, board)
    largest = max(found, key=lambda marker: cv2.contourArea(marker.astype(np.float32)))
    return np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * board.square, largest


def _markers(grey: Image, board: Board) -> tuple[Any, list[Array]]:
    """The dictionary with the most markers found, and the corners of each marker [px], shape (4, 2)."""
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    best: tuple[Any, list[Array]] = None, []
    for name in DICTIONARIES:
        book = cv2.aruco.getPredefinedDictionary(name)
        corners, _, _ = cv2.aruco.ArucoDetector(book, settings).detectMarkers(grey)
        if len(corners) > len(best[1]):
            best = book, [_points(marker) for marker in corners]
    if not best[1]:
        raise BadInput(f"{board.photo}: no ArUco marker was found; show the board in focus, with its white margin.")
    return best


_FINDERS = {"checkerboard": _checkerboard, "charuco": _charuco, "aruco": _aruco}


def _points(corners: Any) -> Array:
    return np.asarray(corners, dtype=float).reshape(-1, 2)


# ----------------------------------------------------------------------------------------------------------------- fit


def _fitted(board: Board, on_board: Array, seen: Array, size: tuple[int, int]) -> Lens:
    """Fit homography and distortion from board corners [m], shape (n, 2), to picture corners [px], shape (n, 2)."""
    from scipy.optimize import least_squares

    middle_of_board = on_board.mean(axis=0)
    across = on_board - middle_of_board
    first, _ = cv2.findHomography(across, seen)
    if first is None or np.linalg.matrix_rank(across) < 2:
        raise BadInput(f"{board.photo}: all corners found lie on one line; show more of the board.")
    terms = (len(seen) >= FEWEST_FOR_LENS) + (len(seen) >= FEWEST_FOR_EDGE)
    unit = math.sqrt(
        abs(np.linalg.det(first / first[2, 2]))
    )  # [px/m], scales all unknowns to the same order of magnitude
    start = np.concatenate([(first / first[2, 2] / [[unit], [unit], [1.0]]).ravel()[:8], np.zeros(terms)])

    def residuals(unknown: Array) -> Array:
        plane, bend = _model(unknown, unit)
        off = project(across, plane, bend, size) - seen
        return np.append(off.ravel(), CORNER * unknown[8:] / USUAL_BEND[:terms])

    found = least_squares(residuals, start, x_scale="jac", method="lm" if len(seen) * 2 > len(start) else "trf")
    freedom = max(2 * len(seen) - len(start), 1)
    rms = math.sqrt(float(np.sum(found.fun[: 2 * len(seen)] ** 2)) / freedom)
    if rms > WORST:
        raise BadInput(
            f"{board.photo}: the corners deviate from a flat board by {rms:.1f} px (rms); use a flat board, and check "
            "its numbers of squares."
        )
    plane, bend = _model(found.x, unit)
    uncertainty = _scale_uncertainty(np.asarray(found.jac), found.x, unit, max(rms, CORNER))
    return _rectified(plane, bend, size, rms, uncertainty)


def _model(unknown: Array, unit: float) -> tuple[Array, tuple[float, float]]:
    plane = np.append(unknown[:8], 1.0).reshape(3, 3) * [[unit], [unit], [1.0]]
    bend = [*map(float, unknown[8:]), 0.0, 0.0]
    return plane, (bend[0], bend[1])


def _local(plane: Array) -> Array:
    """Jacobian of the homography at the board's centre [px/m], shape (2, 2)."""
    return np.asarray((plane[:2, :2] - np.outer(plane[:2, 2], plane[2, :2]) / plane[2, 2]) / plane[2, 2])


def _scale_uncertainty(jacobian: Array, unknown: Array, unit: float, sigma: float) -> float:
    """Relative standard uncertainty of the scale at the board, propagated from the corners' scatter `sigma` [px]."""

    def scale(at: Array) -> float:
        return 0.5 * math.log(abs(np.linalg.det(_local(_model(at, unit)[0]))))

    slope = np.zeros(len(unknown))
    for k in range(8):
        step = np.zeros(len(unknown))
        step[k] = 1e-6 * max(abs(unknown[k]), 1e-3)
        slope[k] = (scale(unknown + step) - scale(unknown - step)) / (2 * step[k])
    spread = np.linalg.pinv(jacobian.T @ jacobian) * sigma**2
    return math.sqrt(max(float(slope @ spread @ slope), 0.0))


def _rectified(plane: Array, bend: tuple[float, float], size: tuple[int, int], rms: float, uncertainty: float) -> Lens:
    """The lens whose rectified pictures keep position, size and rotation of the picture at the board's centre."""
    local = _local(plane)
    left, stretch, right = np.linalg.svd(local)
    like = left @ right * math.sqrt(stretch[0] * stretch[1])  # the similarity closest to the Jacobian; may be mirrored
    middle = plane[:2, 2] / plane[2, 2]
    back = np.eye(3)  # from pixels of the rectified picture to metres on the board
    back[:2, :2] = np.linalg.inv(like)
    back[:2, 2] = -back[:2, :2] @ middle
    whole = plane @ back
    rows = tuple(tuple(map(float, row)) for row in whole / whole[2, 2])
    return Lens(size, rows, bend, scale=1 / math.sqrt(stretch[0] * stretch[1]), uncertainty=uncertainty, residual=rms)
