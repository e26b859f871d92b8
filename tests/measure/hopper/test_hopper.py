"""A hopper that empties: counted records with known truth, and small films drawn with a known opening and last bead."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import av
import cv2
import numpy as np
import numpy.typing as npt
import pytest

import rigtwin
from rigtwin.lab.camera import Camera, Moment
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.progress import silent
from rigtwin.lab.quantity import Check, Evaluation, Measurement, Quantity
from rigtwin.lab.records import Series
from rigtwin.measure.geometry.camera_roll import NOT_SEEN, Upright
from rigtwin.measure.hopper import checks as hopper_checks
from rigtwin.measure.hopper import evaluate as hopper_evaluate
from rigtwin.measure.hopper import free_fall_clock, outflow
from rigtwin.measure.hopper import measurement as hopper
from rigtwin.measure.hopper import observe as hopper_observe
from rigtwin.measure.hopper import scale as hopper_scale
from rigtwin.measure.hopper.lost_frames import timing_check
from rigtwin.measure.hopper.outflow import _bed, _end_of_beads, follow_outflow
from rigtwin.measure.hopper.scale import outlet_profile
from rigtwin.measure.hopper.slide_opening import find_opening
from rigtwin.measure.media.compression import compression_check
from rigtwin.measure.media.video import Video, open_video

Array = npt.NDArray[np.float64]


def find(of: Evaluation | Measurement, quantity: str) -> Quantity:
    return next(one for one in of.quantities if one.quantity == quantity)


def counted(step: float = 0.001, *, opened: float = 0.2, rate: float = 500.0, count: int = 400) -> Series:
    """`count` particles that leave at a steady rate [1/s] from `opened` on."""
    time = np.arange(0, opened + count / rate + 0.2, step)
    gone = np.clip(np.floor((time - opened) * rate + 1e-9), 0, count)
    return Series(time, count - gone, "particles left", "particles")


def test_a_counted_discharge_gives_its_times_and_rate() -> None:
    found = hopper_evaluate.evaluate(counted(), total_mass=0.8, opened=0.2)
    assert find(found, "discharge_time").value == pytest.approx(0.8, abs=0.001)
    assert find(found, "last_particle_time").value == pytest.approx(1.0, abs=0.001)
    assert find(found, "mass_flow_rate").value == pytest.approx(0.8 / 0.8, rel=0.01)
    assert find(found, "mass_flow_rate").unit == "kg/s"
    assert find(found, "discharge_time_5_95").value == pytest.approx(0.72, abs=0.005)
    assert find(found, "residue_fraction").value == 0


def test_an_opening_that_comes_after_most_has_left_is_not_believed() -> None:
    late = hopper_evaluate.evaluate(counted(), opened=0.6)
    assert "which cannot be: is this a hopper" in find(late, "discharge_time").doubtful
    assert not find(late, "residue_fraction").doubtful
    assert not find(hopper_evaluate.evaluate(counted(), opened=0.2), "discharge_time").doubtful


def test_without_a_mass_the_rate_has_its_own_name() -> None:
    record = counted()
    share = Series(record.time, record.value / 400, "fraction left", "1")
    found = hopper_evaluate.evaluate(share, opened=0.2)
    assert find(found, "discharged_fraction_rate").value == pytest.approx(1 / 0.8, rel=0.01)
    assert not any(one.quantity == "mass_flow_rate" for one in found.quantities)


def test_without_an_opening_the_first_loss_is_taken_with_a_warning() -> None:
    found = hopper_evaluate.evaluate(counted())
    assert find(found, "opening_time").value == pytest.approx(0.202, abs=0.002)
    assert any("opening" in warning for warning in found.warnings)


def test_a_straggler_moves_the_last_particle_but_not_the_bulk_of_the_flow() -> None:
    record = counted()
    late = record.value.copy()
    late[(record.time > 0.99) & (record.time < 1.15)] = 1
    plain, drawn_out = (
        hopper_evaluate.evaluate(record, opened=0.2),
        hopper_evaluate.evaluate(Series(record.time, late, "particles left", "particles"), opened=0.2),
    )
    assert find(drawn_out, "discharge_time").value == pytest.approx(0.95, abs=0.002)
    bulk = [find(each, "discharge_time_5_95").value for each in (plain, drawn_out)]
    assert bulk[0] == pytest.approx(bulk[1], abs=0.002)


def test_what_stays_behind_is_reported() -> None:
    record = counted()
    found = hopper_evaluate.evaluate(Series(record.time, record.value + 40, "particles left", "particles"), opened=0.2)
    assert find(found, "residue_fraction").value == pytest.approx(40 / 440)
    assert not next(check for check in found.checks if check.check == "emptied").passed


def test_a_record_that_ends_with_its_last_loss_is_reported_as_cut() -> None:
    record = counted()
    for end, cut in ((0.99, True), (1.2, False)):
        kept = record.time < end
        found = hopper_evaluate.evaluate(
            Series(record.time[kept], record.value[kept], "particles left", "particles"), opened=0.2
        )
        assert next(check for check in found.checks if check.check == "emptied").passed != cut
        for name in ("discharge_time", "last_particle_time", "residue_fraction"):
            assert ("lower bound" in find(found, name).doubtful) == cut


@pytest.mark.parametrize("opened", [0.2, 5.0])
def test_a_record_is_cut_however_long_it_waits_for_the_opening(opened: float) -> None:
    record = counted(opened=opened)
    kept = record.time < opened + 0.7
    found = hopper_evaluate.evaluate(
        Series(record.time[kept], record.value[kept], "particles left", "particles"), opened=opened
    )
    assert "lower bound" in find(found, "discharge_time").doubtful


def test_a_record_of_an_empty_hopper_is_refused() -> None:
    with pytest.raises(BadInput, match="before the opening"):
        hopper_evaluate.evaluate(Series(np.arange(50.0), np.zeros(50), "particles left", "particles"))


def test_a_jam_and_a_record_that_is_too_short_get_different_messages() -> None:
    record = counted()
    jammed = np.maximum(record.value, 350)
    with pytest.raises(NothingToMeasure, match=r"^mass left: .* do not change any more; if beads arch over"):
        hopper_evaluate.evaluate(Series(record.time, jammed, "mass_left", "particles"))
    early = record.time < 0.35
    with pytest.raises(NothingToMeasure, match="record that lasts"):
        hopper_evaluate.evaluate(Series(record.time[early], record.value[early], "particles left", "particles"))


def test_uneven_time_stamps_do_not_change_the_times() -> None:
    random = np.random.default_rng(1)
    record = counted()
    kept = np.sort(random.choice(len(record.time), 600, replace=False))
    found = hopper_evaluate.evaluate(
        Series(record.time[kept], record.value[kept], "particles left", "particles"), opened=0.2
    )
    last = find(found, "last_particle_time")
    assert abs(last.value - 1.0) < 0.006
    assert find(found, "particle_flow_rate").value == pytest.approx(500, rel=0.02)


@pytest.mark.parametrize("back", [0.15, 1.0])
def test_beads_that_come_back_make_times_and_rates_doubtful(back: float) -> None:
    once = counted()
    time, share = np.asarray(once.time), np.asarray(once.value) / 400
    joined = np.concatenate([share, share[np.argmax(share <= back) :]])
    step = float(time[1] - time[0])
    again = Series(step * np.arange(len(joined)), joined, "left", "1")
    assert not any("joined" in one.doubtful for one in hopper_evaluate.evaluate(once).quantities)
    found = hopper_evaluate.evaluate(again).quantities
    assert all(("joined" in one.doubtful) == ("s" in one.unit.split("/")) for one in found)


def test_bad_records_are_refused_in_a_sentence() -> None:
    record = counted()
    with pytest.raises(NothingToMeasure, match="still left"):
        hopper_evaluate.evaluate(Series(record.time, np.full(len(record.time), 400.0), "particles left", "particles"))
    with pytest.raises(BadInput, match="does not increase"):
        hopper_evaluate.evaluate(Series(record.time[::-1].copy(), record.value, "particles left", "particles"))
    with pytest.raises(BadInput, match="five"):
        hopper_evaluate.evaluate(Series(record.time[:3], record.value[:3], "particles left", "particles"))
    with pytest.raises(BadInput, match="positive"):
        hopper_evaluate.evaluate(record, total_mass=-1.0)


def sliding(direction: int, opened: float, speed: float, left: float, right: float) -> npt.NDArray[np.uint8]:
    """What the rows of a slide show that frees a slot; beads fill it from frame 20 to 33."""
    random = np.random.default_rng(8)
    strips = np.empty((40, 280, 12), np.uint8)
    x = np.arange(280.0)
    near = left if direction > 0 else right
    for k in range(40):
        edge = near + direction * speed * (k - opened)
        ends = sorted((edge, edge + direction * 300))
        slide = np.clip(np.minimum(x + 0.5 - ends[0], ends[1] - x + 0.5), 0, 1)
        beads = ((x > left) & (x < right) & (k > 19)).astype(float) * 60 * (k < 34)
        grey = 90 * slide + 170 * (1 - slide) - beads
        strips[k] = np.clip(grey[:, None] + random.normal(0, 2, (280, 12)), 0, 255).astype(np.uint8)
    return strips


@pytest.mark.parametrize("direction", [1, -1])
def test_a_slide_frees_the_slot_between_two_frames_at_the_moment_its_edge_says(direction: int) -> None:
    opened, speed, left, right = 12.37, 17.0, 100.0, 170.0
    strips = sliding(direction, opened, speed, left, right)
    found = find_opening(strips, left - 0.5, right + 0.5, 22)
    assert found is not None
    assert found.direction == direction
    assert found.frame == pytest.approx(opened, abs=0.12)
    assert found.speed == pytest.approx(speed, rel=0.05)


def test_an_opening_from_columns_that_disagree_is_not_sharp() -> None:
    left, right = 100, 170
    strips = sliding(1, 12.0, 17.0, left, right)
    # the slide is gone at once; something faint changes earlier, in no order, in every fourth column
    random = np.random.default_rng(2)
    strips[:12], strips[12:] = strips[0], strips[-1]
    for x in range(left, right, 4):
        strips[int(random.integers(7, 10)) :, x] = strips[-1, x]
    found = find_opening(strips, left - 0.5, right + 0.5, 22)
    assert found is not None
    assert found.frame < 11
    assert abs(found.frame - 11.5) < 3 * found.sigma


def test_what_passes_in_front_of_the_slide_does_not_open_the_slot() -> None:
    opened, left, right = 12.37, 100.0, 170.0
    strips = sliding(1, opened, 17.0, left, right)
    hand = np.zeros(strips.shape[:2], bool)
    hand[6:11, 130:] = True
    strips[hand] = 165
    found = find_opening(strips, left - 0.5, right + 0.5, 22, hand)
    assert found is not None
    assert found.frame == pytest.approx(opened, abs=0.15)
    # a slide that goes behind the hand is not seen to free the slot
    hand[10:20] = True
    assert find_opening(strips, left - 0.5, right + 0.5, 22, hand) is None


# ------------------------------------------------------------------------------------------------------------- films

RATE = 120.0  # [1/s]
SIZE = (220, 300)  # [px]
SLOT_ROW, SLOT_LEFT, SLOT_RIGHT = 150, 85, 135  # [px]
BEAD = 5.0  # [px], radius
DIAMETER = 0.006  # [m], of a bead
OPENED = 8.3  # [frames]
FRAMES = 66  # the last bead leaves at about 48 and lies on the floor at 56


@dataclass(frozen=True)
class Look:
    """How a film of a bed looks that leaves row by row through a slot.

    `hand` gives the place of a hand of the colour `skin` by frame [px]; the beads have one of the `colours` each;
    `noise` is that of the camera [grey levels], `flicker` the amplitude of a 50 Hz lamp as a share of the brightness.
    The slide is `slide` [px] thick and the film is enlarged by `zoom`; the scene looks turned clockwise by `roll`
    [deg], and the camera moves to and fro by `shake` [px].
    """

    hand: Callable[[int], tuple[float, float]] | None = None
    skin: tuple[int, int, int] = (140, 165, 215)
    colours: tuple[tuple[int, int, int], ...] = ((40, 90, 190),)
    flicker: float = 0.0
    noise: float = 2.0
    slide: int = 3
    zoom: int = 1
    roll: float = 0.0
    shake: float = 0.0


# many tests cut or store the same pictures in another way
@lru_cache(maxsize=2)
def drawn(look: Look) -> tuple[list[npt.NDArray[np.uint8]], float]:
    """The pictures, and the frame at which the last bead's upper edge is at the slot."""
    random = np.random.default_rng(5)
    rows, columns = 9, 5
    centres = np.array(
        [(SLOT_LEFT + BEAD * (1 + 2 * c), SLOT_ROW - BEAD * (1 + 1.9 * r)) for r in range(rows) for c in range(columns)]
    )
    begins = OPENED + 2.5 + 3.0 * np.repeat(np.arange(rows), columns) + random.uniform(0, 1.5, rows * columns)
    painted = np.random.default_rng(6).integers(len(look.colours), size=rows * columns)
    fall = 9.81 / RATE**2 * 2 * BEAD / DIAMETER  # [px/frame^2]
    # the last bead's centre is one radius below the slot
    drop = SLOT_ROW + BEAD - centres[:, 1]
    last = float(np.max(begins + np.sqrt(2 * drop / fall)))
    pictures = []
    for k in range(FRAMES):
        picture = np.full((SIZE[1], SIZE[0], 3), (205, 205, 200), np.uint8)
        cv2.rectangle(picture, (0, 286), (220, 300), (90, 120, 140), -1)
        for side in (-1, 1):
            x = SLOT_LEFT - 3 if side < 0 else SLOT_RIGHT + 3
            cv2.line(picture, (x, SLOT_ROW), (x, 20), (120, 120, 125), 4)
        edge = SLOT_LEFT + 14.0 * (k - OPENED) if k > OPENED - 2 else SLOT_LEFT - 28.0
        corners = [(round(16 * edge), 16 * (SLOT_ROW + 2)), (16 * 400, 16 * (SLOT_ROW + 2 + look.slide))]
        cv2.rectangle(picture, *corners, (110, 105, 100), -1, cv2.LINE_AA, 4)
        fallen = 0.5 * fall * np.maximum(k - begins, 0) ** 2
        for n, (x, y) in enumerate(centres):
            at = min(y + fallen[n], 280.0)
            colour = look.colours[painted[n]]
            cv2.circle(picture, (round(16 * x), round(16 * at)), round(16 * BEAD), colour, -1, cv2.LINE_AA, 4)
            spot = (round(16 * (x - 1.5)), round(16 * (at - 1.5)))
            bright = (colour[0] + 80, colour[1] + 80, colour[2] + 50)
            cv2.circle(picture, spot, 20, bright, -1, cv2.LINE_AA, 4)
        if look.hand is not None:
            middle = (round(look.hand(k)[0]), round(look.hand(k)[1]))
            cv2.ellipse(picture, middle, (40, 26), 20, 0, 360, look.skin, -1, cv2.LINE_AA)
        if look.zoom > 1:
            picture = cv2.resize(picture, None, fx=look.zoom, fy=look.zoom, interpolation=cv2.INTER_CUBIC)
        if look.roll:
            turn = cv2.getRotationMatrix2D((SIZE[0] / 2, SIZE[1] / 2), -look.roll, 1.0)  # OpenCV turns anticlockwise
            picture = cv2.warpAffine(picture, turn, SIZE, borderMode=cv2.BORDER_REPLICATE)
        if look.shake:
            shift = look.shake * np.array([math.sin(1.1 * k), math.cos(0.7 * k)])
            picture = cv2.warpAffine(picture, np.c_[np.eye(2), shift], SIZE, borderMode=cv2.BORDER_REPLICATE)
        lamp = 1 + look.flicker * math.sin(2 * math.pi * 100.7 * k / RATE)
        noisy = np.clip(lamp * picture + random.normal(0, look.noise, picture.shape), 0, 255).astype(np.uint8)
        pictures.append(noisy)
    return pictures, last


def film(
    path: Path,
    *,
    crf: int = 14,
    interlaced: bool = False,
    lost: frozenset[int] = frozenset(),
    shown: Sequence[int] | None = None,
    **look: Any,
) -> float:
    """Film a `Look`; returns the frame at which the last bead's upper edge is at the slot.

    The film has gaps where frames are `lost`, or these frames as `shown` one after the other.
    """
    pictures, last = drawn(Look(**look))
    with av.open(str(path), "w") as container:
        options = {"crf": str(crf), "preset": "veryfast" if crf == 14 else "medium", "x264-params": "mbtree=0"}
        stream = container.add_stream("libx264", rate=int(RATE), options=options)
        if interlaced:
            stream.options |= {"x264-params": "interlaced=1"}
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        kept = [k for k in range(FRAMES) if k not in lost]
        for at, k in zip(kept, kept, strict=True) if shown is None else enumerate(shown):
            frame = av.VideoFrame.from_ndarray(pictures[k], format="bgr24")
            frame.pts, frame.time_base = at, Fraction(1, int(RATE))
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return last


def test_a_filmed_discharge_gives_both_ends_within_a_frame(tmp_path: Path) -> None:
    last = film(tmp_path / "hopper.mp4")
    found = hopper.measure(
        tmp_path / "hopper.mp4", Camera(frame_rate=RATE), total_mass=0.1, bead_diameter=0.006, out=tmp_path / "out"
    )
    opening, end = find(found, "opening_time"), find(found, "last_particle_time")
    assert opening.value * RATE == pytest.approx(OPENED, abs=0.5)
    assert end.value * RATE == pytest.approx(last, abs=0.5)
    assert find(found, "discharge_time").value * RATE == pytest.approx(last - OPENED, abs=0.7)
    low, high = find(found, "discharge_time").interval95
    assert low * RATE < last - OPENED < high * RATE
    assert found.camera["slot_width_px"] == pytest.approx(SLOT_RIGHT - SLOT_LEFT, abs=3)
    assert found.camera["slide_goes"] == "right"
    # a flowing bed is 5 to 10 % looser: its area gives a share to 1 or 2 % at either end, and so the time
    middle = find(found, "discharge_time_5_95")
    assert 0.012 < middle.std_uncertainty / middle.value < 0.03
    assert {"overlay", "still", "plot", "record"} <= set(found.files)
    assert all(path.exists() for path in found.files.values())
    assert not any(one.doubtful for one in found.quantities)


def test_a_slot_can_be_stated_and_is_used_as_stated(tmp_path: Path) -> None:
    last = film(tmp_path / "hopper.mp4", roll=3.0)
    turn = cv2.getRotationMatrix2D((SIZE[0] / 2, SIZE[1] / 2), -3.0, 1.0)

    def at(row: float) -> Camera:
        ends = np.array([[SLOT_LEFT, row, 1.0], [SLOT_RIGHT, row, 1.0]]) @ turn.T
        slot = (tuple(ends[0].tolist()), tuple(ends[1].tolist()))
        return Camera(frame_rate=RATE, roll=math.radians(3.0), slot=slot)

    def measured(row: float) -> Measurement:
        return hopper.measure(tmp_path / "hopper.mp4", at(row), bead_diameter=DIAMETER)

    right, below = measured(SLOT_ROW), measured(SLOT_ROW + 30)
    assert find(right, "last_particle_time").value * RATE == pytest.approx(last, abs=0.5)
    assert find(right, "opening_time").value * RATE == pytest.approx(OPENED, abs=0.7)
    assert right.camera["slot_width_px"] == pytest.approx(SLOT_RIGHT - SLOT_LEFT, abs=0.5)
    assert right.camera["stated"] == ["slot"]
    # the last bead falls 30 px more, at 12 px a frame or so
    later = (find(below, "last_particle_time").value - find(right, "last_particle_time").value) * RATE
    assert 1.5 < later < 6.0
    with pytest.raises(NothingToMeasure, match="lies above --slot"):
        measured(3)


@pytest.mark.parametrize(
    ("roll", "stated", "passed", "doubtful"),
    [
        (
            -4.0,
            None,
            None,
            False,
        ),  # no roll was stated, and a stand may be turned by so much: there is nothing to judge
        (12.0, None, False, True),
        (12.0, 12.0, True, False),
        (0.0, 12.0, False, True),
        # the ends of the slot are off by a tenth of a bead then, and by a sixth of its width
        (0.0, 2.0, False, False),
        pytest.param(4.0, 1.1, False, False, marks=pytest.mark.slow),
    ],
)
def test_times_are_right_or_doubtful_however_the_camera_is_turned(
    tmp_path: Path, roll: float, stated: float | None, *, passed: bool | None, doubtful: bool
) -> None:
    last = film(tmp_path / "hopper.mp4", roll=roll)
    camera = Camera(frame_rate=RATE, roll=None if stated is None else math.radians(stated))
    found = hopper.measure(tmp_path / "hopper.mp4", camera)
    rolls = [check for check in found.checks if check.check == "camera_roll"]
    assert [check.passed for check in rolls] == ([] if passed is None else [passed])
    assert all(check.passed or "--camera-roll" in check.message for check in rolls)
    for end, truth in ((find(found, "opening_time"), OPENED), (find(found, "last_particle_time"), last)):
        assert bool(end.doubtful) == doubtful
        assert doubtful or abs(end.value * RATE - truth) < 3 * end.std_uncertainty * RATE
    assert not find(found, "residue_fraction").doubtful


def test_a_hopper_without_a_level_edge_gets_advice_on_the_roll(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    unseen = Upright(0.0, math.radians(2.3), NOT_SEEN, np.empty((0, 4)))
    monkeypatch.setattr(outflow, "upright", lambda picture, given: unseen)
    film(tmp_path / "hopper.mp4")
    found = hopper.measure(tmp_path / "hopper.mp4", Camera(frame_rate=RATE))
    assert any("Give --camera-roll (0deg if" in warning for warning in found.warnings)
    assert "camera_roll" not in {check.check for check in found.checks}


@pytest.mark.slow
@pytest.mark.parametrize(
    "colours",
    [
        ((40, 40, 190), (180, 70, 30)),
        pytest.param(((40, 190, 210), (180, 70, 30)), marks=pytest.mark.slow),
        ((40, 40, 190), (180, 70, 30), (50, 150, 40)),
    ],
)
def test_beads_of_several_colours_are_no_hand(tmp_path: Path, colours: tuple[tuple[int, int, int], ...]) -> None:
    last = film(tmp_path / "mixed.mp4", colours=colours)
    found = hopper.measure(tmp_path / "mixed.mp4", Camera(frame_rate=RATE), bead_diameter=DIAMETER)
    assert find(found, "opening_time").value * RATE == pytest.approx(OPENED, abs=0.5)
    assert find(found, "last_particle_time").value * RATE == pytest.approx(last, abs=0.5)
    assert not any(one.doubtful for one in found.quantities)


@pytest.mark.slow
def test_a_slide_is_no_part_of_the_bed_in_a_large_film_either(tmp_path: Path) -> None:
    last = film(tmp_path / "hopper.mp4", slide=6, zoom=3)
    found = hopper.measure(tmp_path / "hopper.mp4", Camera(frame_rate=RATE))
    for end, truth in ((find(found, "opening_time"), OPENED), (find(found, "last_particle_time"), last)):
        assert end.value * RATE == pytest.approx(truth, abs=1.0)
        assert abs(end.value * RATE - truth) < 2 * end.std_uncertainty * RATE
        assert not end.doubtful


@pytest.mark.slow
def test_a_lamp_that_flickers_changes_nothing(tmp_path: Path) -> None:
    last = film(tmp_path / "lamp.mp4", flicker=0.1)
    found = hopper.measure(tmp_path / "lamp.mp4", Camera(frame_rate=RATE), bead_diameter=DIAMETER)
    assert find(found, "opening_time").value * RATE == pytest.approx(OPENED, abs=0.5)
    assert find(found, "last_particle_time").value * RATE == pytest.approx(last, abs=0.5)
    assert not any(one.doubtful for one in found.quantities)


def handled(
    path: Path, hand: Callable[[int], tuple[float, float]], skin: tuple[int, int, int] = (140, 165, 215)
) -> tuple[list[Quantity], float]:
    """Opening, last particle and discharge time [frames] of a film with a hand in it, and the true last frame."""
    last = film(path, hand=hand, skin=skin)
    found = hopper.measure(path, Camera(frame_rate=RATE), bead_diameter=DIAMETER)
    return [find(found, f"{name}_time") for name in ("opening", "last_particle", "discharge")], last


@pytest.mark.parametrize(
    "skin",
    [
        (140, 165, 215),
        pytest.param((45, 45, 50), marks=pytest.mark.slow),
        (60, 105, 195),
        pytest.param((175, 175, 172), marks=pytest.mark.slow),
    ],
)
def test_a_hand_before_the_slot_does_not_open_it(tmp_path: Path, skin: tuple[int, int, int]) -> None:
    # over the slot's right half until shortly before the slide moves, whether it looks like skin, a glove, beads or not
    times, last = handled(
        tmp_path / "hand.mp4", lambda k: (265.0 - 110 * math.exp(-(((k - 4) / 1.5) ** 2)), 155.0), skin
    )
    opening, end, lasted = times
    assert opening.value * RATE == pytest.approx(OPENED, abs=0.5)
    assert "in front of the hopper" in opening.doubtful
    assert end.value * RATE == pytest.approx(last, abs=0.5)
    assert lasted.doubtful


@pytest.mark.slow
def test_a_hand_before_the_last_bead_makes_its_time_doubtful(tmp_path: Path) -> None:
    times, last = handled(tmp_path / "hand.mp4", lambda k: (155.0 if 38 < k < 60 else 265.0, 155.0))
    low, high = times[1].interval95
    assert times[1].doubtful
    assert low * RATE < last < high * RATE


@pytest.mark.slow
def test_a_hand_before_a_bed_of_two_colours_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "hand.mp4"

    def reaching(k: int) -> tuple[float, float]:
        return (155.0 if 38 < k < 60 else 265.0, 155.0)

    last = film(path, hand=reaching, colours=((40, 40, 190), (180, 70, 30)))
    found = hopper.measure(path, Camera(frame_rate=RATE), bead_diameter=DIAMETER, out=tmp_path / "out")
    end = find(found, "last_particle_time")
    low, high = end.interval95
    assert end.doubtful
    assert low * RATE < last < high * RATE


@pytest.mark.slow
def test_a_film_with_something_in_front_throughout_is_doubtful(tmp_path: Path) -> None:
    # ever elsewhere beside the bed, so that it is in no picture of the hopper before or after
    film(tmp_path / "hand.mp4", hand=lambda k: (25.0 if k % 2 else 195.0, (30.0, 75.0, 115.0)[k % 3]))
    found = hopper.measure(tmp_path / "hand.mp4", Camera(frame_rate=RATE), bead_diameter=DIAMETER)
    assert all(one.doubtful for one in found.quantities if one.unit == "s")


@pytest.mark.parametrize("middle", [178.0, 180.0])  # [px]: its tip hides more than half of the slot, and less
def test_what_stands_before_the_middle_of_the_slot_makes_its_times_doubtful(tmp_path: Path, middle: float) -> None:
    film(tmp_path / "hidden.mp4", hand=lambda _: (110.0, middle), skin=(175, 175, 172))
    found = hopper.measure(tmp_path / "hidden.mp4", Camera(frame_rate=RATE), bead_diameter=DIAMETER)
    assert "slot_in_view" in {check.check for check in found.checks if not check.passed}
    assert find(found, "last_particle_time").doubtful


def test_a_picture_that_has_changed_everywhere_has_no_bed() -> None:
    assert _bed(np.ones((8, 8), dtype=bool), np.zeros((8, 8, 3), dtype=np.uint8)) is None


def test_a_post_before_a_bed_hides_what_it_covers_of_the_slot_and_a_hollow_surface_hides_nothing() -> None:
    row, column = np.mgrid[:100, :200]
    bed = (np.abs(column - 100) < 90 - 0.7 * row) & (row > 10 + 0.5 * (90 - np.abs(column - 100)))
    edges, bead = (79.5, 120.5), 10.0
    assert hopper_checks.before_the_slot(bed, edges, bead) == set()
    # over an end of the slot, over its middle, and beside it, where the last beads reach half a diameter behind it
    for left, covered in ((70, range(75, 82)), (95, range(95, 107)), (122, range(122, 126)), (130, ())):
        post = (column >= left) & (column < left + 12)
        assert hopper_checks.before_the_slot(bed & ~post, edges, bead) == set(covered)


@pytest.mark.parametrize("comes", [3, pytest.param(6, marks=pytest.mark.slow)])  # [frames]; the slide moves at frame 8
def test_a_bed_that_is_not_seen_while_it_leaves_has_a_rate_that_is_doubtful(tmp_path: Path, comes: int) -> None:
    film(tmp_path / "hand.mp4", hand=lambda k: (110.0, 105.0) if comes <= k < comes + 32 else (20.0, 20.0))
    found = hopper.measure(tmp_path / "hand.mp4", Camera(frame_rate=RATE), bead_diameter=DIAMETER)
    rate = find(found, "discharged_fraction_rate")
    assert not next(check for check in found.checks if check.check == "bed_uncovered").passed
    assert "keep the view of bed and slot free" in rate.doubtful


def test_a_hand_that_pulls_the_slide_from_afar_is_no_trouble(tmp_path: Path) -> None:
    times, last = handled(tmp_path / "hand.mp4", lambda k: (220.0 + 14 * max(k - OPENED, -2), 155.0))
    assert times[2].value * RATE == pytest.approx(last - OPENED, abs=0.7)
    assert not any(time.doubtful for time in times)


@pytest.mark.slow
def test_lost_frames_make_the_beads_no_faster_at_the_outlet(tmp_path: Path) -> None:
    speeds = []
    for name, lost in (("whole.mp4", frozenset[int]()), ("lost.mp4", frozenset(range(14, 70, 3)))):
        film(tmp_path / name, lost=lost)
        video = open_video(tmp_path / name, Camera(frame_rate=RATE))
        seen = follow_outflow(video, Camera(roll=0.0), bead=2 * BEAD, progress=silent)
        speeds.append(float(np.nanmean(outlet_profile(seen, 1.0)[1])))
    assert speeds[1] == pytest.approx(speeds[0], rel=0.1)


def judged(path: Path, check: str, rate: float = RATE) -> Check:
    """What a film's measurement says under this name."""
    found = hopper.measure(path, Camera(frame_rate=rate, scale=DIAMETER / (2 * BEAD)))
    return next(one for one in found.checks if one.check == check)


@pytest.mark.parametrize(
    "lost",
    [
        [],
        pytest.param([20], marks=pytest.mark.slow),
        [16, 23, 24, 31],
        pytest.param(list(range(2, FRAMES, 7)), marks=pytest.mark.slow),
    ],
)
def test_frames_missing_from_the_flow_are_counted(tmp_path: Path, lost: list[int]) -> None:
    last = film(tmp_path / "lost.mp4", shown=[k for k in range(FRAMES) if k not in lost])
    check = judged(tmp_path / "lost.mp4", "frame_timing")
    assert check.passed == (not lost)
    fewest, *most = re.findall(r"(\d+)(?: to (\d+))? frames of", check.message)[0] if lost else ("0",)
    missing = sum(OPENED < k < last for k in lost)
    # before the first bead is well below the slot nothing is seen to fall
    assert 0.4 * missing <= int(fewest) <= missing <= int((most or [fewest])[0] or fewest)


@pytest.mark.parametrize("cut", [0, 5, 9])
def test_many_frames_cut_out_of_the_flow_are_detected_by_the_bed_that_is_gone(cut: int) -> None:
    """No bead that falls before the gap is seen after it, but some 40 beads leave in every frame."""
    rng = np.random.default_rng(4)
    gone = rng.poisson(40, 70).astype(np.float64)
    after = np.r_[gone[:30], gone[30 : 31 + cut].sum(), gone[31 + cut :]]
    ones = np.ones(len(after))
    check = timing_check(ones, ones, rng.normal(10, 1, len(after)), after)
    assert isinstance(check, Check)
    assert check.passed == (cut == 0)
    assert check.value == pytest.approx(cut, abs=0.4 * cut)


@pytest.mark.parametrize("seen", [True, False])
def test_a_cut_in_a_flow_of_bursts_is_detected_where_no_bead_is_seen_on_both_sides_of_it(*, seen: bool) -> None:
    gone = np.tile([15.0, 65.0, 40.0, 25.0, 55.0], 14)
    gone[30] = 5 * 40.0
    shown = np.ones(len(gone))
    shown[30] = 1.0 if seen else math.nan
    check = timing_check(np.ones(len(gone)), shown, np.tile([10.0, 11.0], 35), gone)
    assert isinstance(check, Check)
    assert check.passed == seen


@pytest.mark.slow
@pytest.mark.parametrize(("scatter", "unseen"), [pytest.param(0.58, 0.05, marks=pytest.mark.slow), (0.71, 0.15)])
def test_bursts_in_which_no_bead_is_seen_to_fall_here_and_there_are_no_cuts(scatter: float, unseen: float) -> None:
    rng, convicted, flows = np.random.default_rng(11), 0, 300
    changes = np.tile([10.0, 11.0], 35)
    for _ in range(flows):
        gone = rng.gamma(1 / scatter**2, 40 * scatter**2, 70)
        shown = np.where(rng.random(70) < unseen, math.nan, 1.0)
        check = timing_check(np.ones(70), shown, changes, gone)
        assert isinstance(check, Check)
        convicted += not check.passed
    # one in a hundred, and two standard deviations of their number
    assert convicted <= flows * 0.01 + 2 * math.sqrt(flows * 0.01)


def test_frames_that_the_times_say_are_missing_are_no_trouble(tmp_path: Path) -> None:
    film(tmp_path / "gaps.mp4", lost=frozenset(range(16, 40, 5)))
    assert judged(tmp_path / "gaps.mp4", "frame_timing").passed


@pytest.mark.parametrize(
    ("every", "crf"),
    [(3, 14), pytest.param(3, 28, marks=pytest.mark.slow), pytest.param(5, 14, marks=pytest.mark.slow), (5, 28)],
)
def test_frames_shown_twice_in_the_flow_are_detected(tmp_path: Path, every: int, crf: int) -> None:
    film(tmp_path / "twice.mp4", crf=crf, shown=[k for k in range(FRAMES) for _ in range(2 if k % every == 0 else 1)])
    check = judged(tmp_path / "twice.mp4", "frame_timing")
    assert not check.passed
    assert f"about one in {every + 1}:" in check.message
    assert f"{1 + 1 / every:.2f} times too long" in check.message


def test_a_film_that_shows_each_frame_three_times_is_detected() -> None:
    ones = np.ones(60)
    check = timing_check(ones, ones, np.tile([10.0, 0.2, 0.2], 20) + np.arange(60) / 100, ones)
    assert isinstance(check, Check)
    assert not check.passed
    (longer,) = re.findall(r"([\d.]+) times too long", check.message)
    assert float(longer) == pytest.approx(3, abs=0.4)


def test_frames_shown_in_place_of_the_next_do_not_lengthen_the_flow(tmp_path: Path) -> None:
    film(tmp_path / "held.mp4", shown=[k - 1 if k % 5 == 4 else k for k in range(FRAMES)])
    check = judged(tmp_path / "held.mp4", "frame_timing")
    assert not check.passed
    assert "they replace missing frames" in check.message


@pytest.mark.parametrize(
    ("every", "stated"),
    [
        (1, 1.0),
        pytest.param(2, 0.5, marks=pytest.mark.slow),
        (2, 1.0),
        pytest.param(1, 0.5, marks=pytest.mark.slow),
        pytest.param(1, 2.0, marks=pytest.mark.slow),
    ],
)
def test_falling_beads_show_a_frame_rate_that_is_not_theirs(tmp_path: Path, every: int, stated: float) -> None:
    film(tmp_path / "rate.mp4", shown=range(0, FRAMES, every))
    check = judged(tmp_path / "rate.mp4", "frame_rate", stated * RATE)
    assert check.passed == (stated * every == 1)
    assert abs(math.log(check.value / 9.81 / (stated * every) ** 2)) < 0.3


@pytest.mark.slow
def test_what_is_advised_for_a_scale_was_not_given_already(tmp_path: Path) -> None:
    film(tmp_path / "hopper.mp4")

    def advised(width: float | None) -> str:
        found = hopper.measure(tmp_path / "hopper.mp4", Camera(frame_rate=RATE), bin_width=width)
        return next(warning for warning in found.warnings if warning.startswith("outlet velocity"))

    assert "give --bin-width or --scale" in advised(None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hopper_scale, "bin_walls", lambda scenery: None)
        assert "give --bin-width" not in advised(0.03)


def test_what_shows_up_above_the_last_bead_for_a_frame_is_no_bead() -> None:
    sinks = np.array([60.0, 66, 72, 78, 84, 90, 96, 103, 111, math.inf])
    assert hopper_observe._still_above(sinks, 100.0, 10.0)[-1] == 6
    assert hopper_observe._still_above(np.append(np.insert(sinks, 8, 20.0), math.inf), 100.0, 10.0)[-1] == 6
    # but a bead that is overlooked in a frame or two was there before
    assert hopper_observe._still_above(np.insert(sinks, 6, [math.inf, math.inf]), 100.0, 10.0)[-1] == 8


@pytest.mark.parametrize("cut", [2, 11])  # [frames]: an earlier bead is seen below the slot after it, and none
def test_a_last_bead_that_disappears_above_the_slot_is_doubtful(tmp_path: Path, cut: int) -> None:
    last = film(tmp_path / "gone.mp4")
    film(tmp_path / "gone.mp4", shown=[*range(math.floor(last) - 1), *range(math.ceil(last) + cut - 1, FRAMES)])
    camera = Camera(frame_rate=RATE, scale=DIAMETER / (2 * BEAD))
    found = hopper.measure(tmp_path / "gone.mp4", camera, bead_diameter=DIAMETER)
    assert "disappears" in find(found, "last_particle_time").doubtful
    assert "disappears" in find(found, "discharge_time").doubtful


@pytest.mark.slow
def test_a_last_bead_that_disappears_after_frames_that_do_not_show_it_is_doubtful(tmp_path: Path) -> None:
    last = math.floor(film(tmp_path / "gone.mp4"))

    def hand(k: int) -> tuple[float, float]:
        return (150.0, 60.0) if last - 6 <= k < last - 2 else (265.0, 20.0)

    film(tmp_path / "gone.mp4", hand=hand, shown=[*range(last - 1), *range(last + 3, FRAMES)])
    camera = Camera(frame_rate=RATE, scale=DIAMETER / (2 * BEAD))
    found = hopper.measure(tmp_path / "gone.mp4", camera, bead_diameter=DIAMETER, out=tmp_path)
    assert "disappears" in find(found, "last_particle_time").doubtful


def test_a_clip_that_ends_while_beads_leave_has_nothing_that_is_not_doubtful(tmp_path: Path) -> None:
    last = film(tmp_path / "hopper.mp4")
    for end in (0.6, 0.85):
        camera = Camera(frame_rate=RATE, end=Moment(round(end * last), "frame"))
        found = hopper.measure(tmp_path / "hopper.mp4", camera, bead_diameter=0.006)
        assert all(one.doubtful for one in found.quantities)
        assert find(found, "residue_fraction").std_uncertainty > 0.2
        assert find(found, "discharge_time").value * RATE < last - OPENED


def test_a_film_broken_off_has_nothing_that_is_not_doubtful(tmp_path: Path) -> None:
    clip = tmp_path / "hopper.mkv"
    film(clip)
    clip.write_bytes(clip.read_bytes()[: int(0.97 * clip.stat().st_size)])
    found = hopper.measure(clip, Camera(frame_rate=RATE), bead_diameter=0.006, out=tmp_path / "out")
    assert all("broken off" in one.doubtful for one in found.quantities)


# beads drawn in straight rows lie nearer to each other than those of a bed, by a seventh
@pytest.mark.parametrize(
    ("factor", "passed"), [(1.15, True), (0.8, False), pytest.param(1.6, False, marks=pytest.mark.slow)]
)
def test_two_scales_that_contradict_make_velocities_doubtful(tmp_path: Path, factor: float, passed: bool) -> None:
    film(tmp_path / "hopper.mp4")
    scale = factor * 0.006 / (2 * BEAD)
    found = hopper.measure(
        tmp_path / "hopper.mp4", Camera(frame_rate=RATE, scale=scale), bead_diameter=0.006, out=tmp_path / "out"
    )
    assert next(check for check in found.checks if check.check == "bead_size").passed == passed
    found = [one for one in found.quantities if one.quantity == "outlet_velocity"]
    assert found
    assert all(("check --bead-diameter" in one.doubtful) != passed for one in found)


def test_times_of_an_interlaced_film_are_doubtful_and_shares_are_not(tmp_path: Path) -> None:
    film(tmp_path / "hopper.mp4", interlaced=True)
    found = hopper.measure(tmp_path / "hopper.mp4", Camera(frame_rate=RATE))
    doubtful = {one.quantity for one in found.quantities if "interlaced" in one.doubtful}
    assert {"opening_time", "last_particle_time", "discharge_time"} <= doubtful
    assert "residue_fraction" not in doubtful


@pytest.mark.parametrize("crf", [40, 51])
def test_an_over_compressed_clip_is_right_within_a_frame_or_doubtful(tmp_path: Path, crf: int) -> None:
    last = film(tmp_path / "hopper.mp4", crf=crf)
    found = hopper.measure(tmp_path / "hopper.mp4", Camera(frame_rate=RATE))
    for end, truth in ((find(found, "opening_time"), OPENED), (find(found, "last_particle_time"), last)):
        assert end.budget["compression"] * RATE == pytest.approx(1, rel=0.01)
        assert end.doubtful or abs(end.value * RATE - truth) < 2 * end.std_uncertainty * RATE
        assert bool(end.doubtful) is (crf == 51)


@pytest.mark.slow
def test_noise_far_below_the_contrast_of_beads_makes_nothing_doubtful(tmp_path: Path) -> None:
    last = film(tmp_path / "hopper.mp4", noise=10.0, crf=6)
    found = hopper.measure(tmp_path / "hopper.mp4", Camera(frame_rate=RATE))
    assert 8 < next(check for check in found.checks if check.check == "bed_clear").value * hopper_checks.BED_CLEAR < 18
    for end, truth in ((find(found, "opening_time"), OPENED), (find(found, "last_particle_time"), last)):
        assert abs(end.value * RATE - truth) < 3 * end.std_uncertainty * RATE
        assert not end.doubtful


def test_a_codecs_bits_count_where_something_moves(tmp_path: Path) -> None:
    (tmp_path / "film.mp4").write_bytes(bytes(1000))
    film = cast(Video, SimpleNamespace(path=tmp_path / "film.mp4", width=100, height=80, times=range(10)))
    assert compression_check(film, 0.05).passed  # 8000 bits for 80000 pixels
    assert not compression_check(film, 0.2).passed
    small = compression_check(film, 0.2, moving=0.25)
    assert small.passed
    assert small.value == pytest.approx(0.4)


# the larger one is measured at 0.8 of its size
@pytest.mark.parametrize("zoom", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_a_still_films_bits_are_those_of_the_bed(tmp_path: Path, zoom: int) -> None:
    film(tmp_path / "hopper.mp4", crf=34, zoom=zoom)
    bed = (SLOT_RIGHT - SLOT_LEFT) * 2 * BEAD * (1 + 8 * 0.95) * zoom**2
    bits = 8 * (tmp_path / "hopper.mp4").stat().st_size / (FRAMES * bed)
    assert judged(tmp_path / "hopper.mp4", "compression").value == pytest.approx(bits, rel=0.2)


@pytest.mark.slow
def test_few_bits_add_a_frame_of_uncertainty_and_those_of_a_shaken_film_are_too_few(tmp_path: Path) -> None:
    """A codec spends them all over a picture that shakes, and leaves out in it what it shows of a still one."""
    found = []
    for name, shake in (("still.mp4", 0.0), ("shaken.mp4", 1.0)):
        last = film(tmp_path / name, crf=40, shake=shake)
        found.append(hopper.measure(tmp_path / name, Camera(frame_rate=RATE)))
    still, shaken = (next(one for one in each.checks if one.check == "compression") for each in found)
    assert still.passed
    assert "timing uncertainty includes one frame" in still.message
    lasted = find(found[0], "discharge_time")
    assert not lasted.doubtful
    assert abs(lasted.value * RATE - (last - OPENED)) < 3 * lasted.std_uncertainty * RATE
    assert not shaken.passed
    assert "of the moving part" in still.message
    assert "too few; low-contrast motion freezes" in find(found[1], "discharge_time").doubtful
    bits = 8 * (tmp_path / "shaken.mp4").stat().st_size / (FRAMES * SIZE[0] * SIZE[1])
    assert f"has {bits:.3g} bits per pixel: too few" in shaken.message


@pytest.mark.parametrize("stated", [pytest.param(0.5 * RATE, marks=pytest.mark.slow), 2 * RATE])
def test_a_frame_rate_off_by_two_shows_in_how_the_first_beads_fall(tmp_path: Path, stated: float) -> None:
    film(tmp_path / "hopper.mp4")
    found = hopper.measure(tmp_path / "hopper.mp4", Camera(frame_rate=stated), bead_diameter=DIAMETER)
    check = next(check for check in found.checks if check.check == "frame_rate")
    assert not check.passed
    assert check.value == pytest.approx(9.81 * (stated / RATE) ** 2, rel=0.25)
    assert "--frame-rate" in find(found, "discharge_time").doubtful
    assert not find(found, "residue_fraction").doubtful


@pytest.mark.parametrize("floor", [8.0, 20.0, 200.0])
def test_the_fall_of_the_lowest_bead_is_distinguished_from_creeping_and_from_rest(floor: float) -> None:
    """In bead diameters of 10 px: it creeps out of the slot, falls, and comes to rest."""
    time = np.arange(60) / 240
    after = np.maximum(time - 0.06, 0)
    fall = np.round(np.minimum(3 + 40 * time + 0.5 * 20000 * after**2, 10 * floor))
    found = free_fall_clock.fall_below(time, fall[None], 10.0)
    assert found is not None
    assert abs(found.acceleration - 20000) < 2 * found.uncertainty
    assert free_fall_clock.fall_below(time, np.round(400 * time)[None], 10.0) is None


def test_two_looks_at_a_fall_that_contradict_each_other_leave_it_doubtful() -> None:
    alike = free_fall_clock.together([free_fall_clock.FreeFall(98.0, 3.0), None, free_fall_clock.FreeFall(102.0, 3.0)])
    other = free_fall_clock.together([free_fall_clock.FreeFall(98.0, 3.0), free_fall_clock.FreeFall(150.0, 3.0)])
    assert alike is not None
    assert other is not None
    assert (alike.acceleration, alike.uncertainty) == (pytest.approx(100.0), pytest.approx(3.0 / math.sqrt(2)))
    # the uncertainty covers both
    assert other.acceleration - other.uncertainty <= 98.5
    assert other.acceleration + other.uncertainty >= 149.5
    assert free_fall_clock.together([None]) is None


@pytest.mark.parametrize("uncertainty", [0.01, 0.1, 0.3])
def test_a_fall_that_fits_states_which_frame_rates_would_not_show(uncertainty: float) -> None:
    fall = free_fall_clock.FreeFall(9810.0, uncertainty * 9810.0)
    fits = free_fall_clock.fall_check(fall, 0.001, 0.0, RATE)
    factor = float(fits.message.split("a factor of ")[1].split()[0])
    assert fits.passed
    # the same frames with a stated rate that is faster or slower
    for stated, passed in ((0.97 * factor, True), (1.03 * factor, False)):
        for times in (stated, 1 / stated):
            other = free_fall_clock.FreeFall(times**2 * fall.acceleration, times**2 * fall.uncertainty)
            assert free_fall_clock.fall_check(other, 0.001, 0.0, times * RATE).passed == passed


@pytest.mark.parametrize(("slowed", "passed"), [(1, True), (8, False), (33, False)])
def test_beads_that_leave_far_slower_than_gravity_lets_them_were_played_in_slow_motion(
    slowed: int, passed: bool
) -> None:
    width, bead = 0.034, 0.006
    effective = width - 1.4 * bead
    # Beverloo's law for a slot, its flow spread over the slot
    speed = 1.03 * math.sqrt(9.81 * effective) * effective / width / 0.8
    found = free_fall_clock.outlet_check(speed / slowed, width)
    assert found.passed == passed
    if passed:
        low, high = (float(each) for each in re.findall(r"([\d.]+) times too", found.message))
        # a rate that is too high makes beads faster than they are
        for too_high, possible in ((0.95 * high, True), (1.05 * high, False), (1.05 / low, True), (0.95 / low, False)):
            truth = speed / too_high
            assert free_fall_clock.outlet_check(truth, width).passed == possible


def test_a_wrong_frame_rate_spoils_what_is_counted_in_seconds_and_nothing_else() -> None:
    slow = free_fall_clock.outlet_check(0.02, 0.034)
    units = {"discharge_time": "s", "mass_flow_rate": "kg/s", "outlet_velocity": "m/s", "residue_fraction": "1"}
    made = tuple(Quantity(name, 0.5, 0.01, unit, "made up") for name, unit in units.items())
    judged = {
        one.quantity: one for one in hopper_evaluate.with_times_doubted(made, hopper_evaluate.failed_message(slow))
    }
    assert [name for name, one in judged.items() if "--frame-rate" in one.doubtful] == list(units)[:3]
    assert judged["residue_fraction"] == made[3]


def test_a_picture_that_ends_at_the_slot_is_refused_in_a_sentence(tmp_path: Path) -> None:
    film(tmp_path / "whole.mp4")
    with av.open(str(tmp_path / "whole.mp4")) as whole, av.open(str(tmp_path / "cut.mp4"), "w") as cut:
        stream = cut.add_stream("libx264", rate=int(RATE), options={"crf": "14"})
        stream.width, stream.height, stream.pix_fmt = SIZE[0], SLOT_ROW + 2, "yuv420p"
        for frame in whole.decode(video=0):
            upper = np.ascontiguousarray(frame.to_ndarray(format="bgr24")[: SLOT_ROW + 2])
            for packet in stream.encode(av.VideoFrame.from_ndarray(upper, format="bgr24")):
                cut.mux(packet)
        for packet in stream.encode():
            cut.mux(packet)
    with pytest.raises(NothingToMeasure, match=r"the slot found lies at y = \d+ px, less than a bead diameter"):
        hopper.measure(tmp_path / "cut.mp4", Camera(frame_rate=RATE), bead_diameter=DIAMETER)


def test_a_clip_in_which_nothing_leaves_is_refused(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    with av.open(str(tmp_path / "still.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=60, options={"x264-params": "mbtree=0"})
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        for _ in range(14):
            picture = np.full((SIZE[1], SIZE[0], 3), 150, np.uint8)
            cv2.circle(picture, (100, 100), 40, (40, 90, 190), -1)
            noisy = np.clip(picture + random.normal(0, 3, picture.shape), 0, 255).astype(np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(noisy, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    with pytest.raises(NothingToMeasure):
        hopper.measure(tmp_path / "still.mp4", Camera(frame_rate=60.0))


@pytest.mark.parametrize("slide", [-2.5, 1.2])
def test_beads_end_where_the_slide_begins_though_it_looks_like_beads(slide: float) -> None:
    beads, gap = [2.4, 2.4, 2.5, 2.4, 1.9, 1.4], [0.4 if slide > 0 else -0.4, 0.1]
    ended, level = _end_of_beads(np.array([*beads, *gap, slide, slide, slide, -3.0]), 3)
    assert ended == len(beads)
    assert level < 1.4


def test_where_all_looks_like_beads_no_end_of_them_is_found() -> None:
    assert _end_of_beads(np.full(12, 2.0), 3) == (0, 0.0)


@pytest.mark.parametrize(("count", "passed"), [(400, True), (700, False)])
def test_a_filling_that_is_far_from_the_bed_seen_fails_its_check(count: int, passed: bool) -> None:
    film = Path(__file__).parents[3] / "sample_media" / "seven_rigs" / "hopper.mp4"
    bead = 4 / 3 * math.pi * 3.1e-3**3 * 569  # [kg]
    found = rigtwin.measure(
        "hopper", film, bin_width="60 mm", depth="40 mm", bead_diameter="6.2 mm", bead_density="569 kg/m^3",
        frame_rate="120 Hz", total_mass=f"{1e3 * count * bead} g",
    )  # fmt: skip
    (check,) = (one for one in found.checks if one.check == "filling_mass")
    assert check.passed == passed
