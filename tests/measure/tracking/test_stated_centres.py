"""Centres that are stated by hand take the place of those that were located."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from rigtwin.cli import run
from rigtwin.lab.camera import STATED_SIGMA, Camera, Moment, Seed, span
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.measure.drop import measurement as drop
from rigtwin.measure.pendulum import measurement as pendulum
from rigtwin.measure.tilt import measurement as tilt

MEDIA = Path(__file__).parents[3] / "sample_media"
CLIP, DOUBLE = MEDIA / "drop" / "r01.mp4", MEDIA / "pendulum" / "r01.mp4"
SLIDE = MEDIA / "seven_rigs" / "tilt.mp4"
BEAD = 0.006  # [m]


def tracks(result):
    """Places [px] by frame, of each body."""
    return [dict(zip(mark.frames, mark.points, strict=True)) for mark in result.marks if mark.kind == "track"]


def value(result, quantity, method):
    return next(q.value for q in result.quantities if (q.quantity, q.method) == (quantity, method))


def measured(clip, *centres, **camera):
    """The fall and the first two impacts."""
    return drop.measure(clip, Camera(centre=centres, end=Moment(115, "frame"), **camera), bead_diameter=BEAD)


def tilted(clip, *centres):
    return tilt.measure(clip, Camera(frame_rate=100.0, scale=5e-4, centre=centres), variant="slide")


SWING = Camera(frame_rate=240.0, end=Moment(120, "frame"))


@pytest.fixture(scope="module")
def swung():
    return pendulum.measure(DOUBLE, SWING)


@pytest.fixture(scope="module")
def slid():
    return tilted(SLIDE)


@pytest.fixture(scope="module")
def found():
    return measured(CLIP)


def test_a_stated_centre_takes_the_place_of_the_one_that_was_found(found):
    (path,) = tracks(found)
    x, y = path[40]
    moved = measured(CLIP, Seed(40, (x + 12, y)))
    (seen,) = tracks(moved)
    assert seen[40] == pytest.approx((x + 12, y))
    at = list(seen).index(40)
    sigma = moved.tracks[0].sigma / moved.camera["scale_m_per_px"]
    assert sigma[at] == pytest.approx(STATED_SIGMA)
    assert np.all(sigma[[at - 1, at + 1]] < 0.2)
    assert moved.camera["stated"] == ["centre"]
    (said,) = [each for each in moved.warnings if "stated" in each]
    assert said == (
        f"--centre 40:{x + 12:g},{y:g} is used as stated, but lies 12 px from the body, which is seen at "
        f"{x:.0f},{y:.0f} in this frame."
    )
    # one wrong point among many does not spoil the flights
    restitution = value(found, "restitution_wall", "velocity")
    assert value(moved, "restitution_wall", "velocity") == pytest.approx(restitution, abs=0.001)


def test_a_bead_that_is_hidden_is_where_it_is_stated_to_be(found, tmp_path):
    (path,) = tracks(found)
    clip = covered(tmp_path / "covered.mp4", {frame: path[frame] for frame in range(60, 64)})
    (without,) = tracks(measured(clip, frame_rate=240.0))
    assert 61 not in without
    (seen,) = tracks(measured(clip, Seed(61, tuple(path[61])), frame_rate=240.0))
    assert seen[61] == pytest.approx(path[61], abs=0.01)
    assert set(seen) == {*without, 61}


def test_a_refusal_names_a_stated_centre_that_is_far_from_the_body(found):
    (path,) = tracks(found)
    x, y = path[40]
    with pytest.raises(NothingToMeasure) as refused:
        measured(CLIP, Seed(40, (x, y - 150)))
    said = refused.value.message
    assert said.startswith(f"{CLIP}: --centre 40:{x:g},{y - 150:g} is used as stated, but lies 150 px from")
    assert "in this frame: leave it out, or correct it, first. With it nothing was measured: " in said


def covered(target, places, clip=CLIP):
    """The clip with a flat patch over the bead in some frames."""
    with av.open(str(clip)) as source, av.open(str(target), "w") as copy:
        (video,) = source.streams.video
        stream = copy.add_stream("libx264", rate=video.average_rate, options={"crf": "10", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = video.width, video.height, "yuv420p"
        for number, frame in enumerate(source.decode(video)):
            picture = frame.to_ndarray(format="bgr24")
            if number in places:
                x, y = np.rint(places[number]).astype(int)
                picture[y - 25 : y + 25, x - 25 : x + 25] = picture[y - 25 : y + 25, x + 25 : x + 26]
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")):
                copy.mux(packet)
        for packet in stream.encode():
            copy.mux(packet)
    return target


def test_a_stated_centre_is_that_of_the_bead_next_to_it(swung):
    a, b = tracks(swung)
    frame = next(frame for frame in a if frame > 20 and frame in b)
    (xa, ya), (xb, yb) = a[frame], b[frame]
    stated = Seed(frame, (xb + 3, yb)), Seed(frame, (xa - 2, ya))
    first, second = tracks(pendulum.measure(DOUBLE, replace(SWING, centre=stated)))
    assert first[frame] == pytest.approx((xa - 2, ya), abs=0.01)
    assert second[frame] == pytest.approx((xb + 3, yb), abs=0.01)


@pytest.mark.parametrize("away", [20, pytest.param(120, marks=pytest.mark.slow)])
def test_a_centre_of_a_pendulum_that_is_far_from_its_bead_is_named(swung, away):
    a, _ = tracks(swung)
    x, y = a[30]
    moved = pendulum.measure(DOUBLE, replace(SWING, centre=(Seed(30, (x, y + away)),)))
    (said,) = [each for each in moved.warnings if "stated" in each]
    assert said.startswith(f"--centre 30:{x:g},{y + away:g} is used as stated, but lies {away} px from the body")


def test_two_centres_that_both_beads_of_a_pendulum_cannot_have_are_refused():
    camera = replace(SWING, centre=(Seed(30, (300.0, 300.0)), Seed(30, (303.0, 300.0))))
    with pytest.raises(
        BadInput, match=r"--centre 30:300,300 and --centre 30:303,300 are 3 px apart.*leave one of them"
    ):
        pendulum.measure(DOUBLE, camera)


def test_a_stated_centre_of_a_tilt_takes_the_place_of_the_one_that_was_found(slid):
    (path,) = tracks(slid)
    moved = tilted(SLIDE, Seed(100, (path[100][0] + 9, path[100][1])))
    (seen,) = tracks(moved)
    away = {frame: np.subtract(place, path[frame]) for frame, place in seen.items()}
    assert set(seen) == set(path)
    assert away.pop(100) == pytest.approx((9, 0), abs=0.01)
    assert np.abs(list(away.values())).max() < 0.01
    assert moved.tracks[0].sigma[list(seen).index(100)] / 5e-4 == pytest.approx(STATED_SIGMA, abs=0.01)
    (said,) = [each for each in moved.warnings if "stated" in each]
    assert said.startswith("--centre 100:")
    assert "lies 9 px from the body" in said
    angles = [value(each, "static_friction_angle", "onset") for each in (slid, moved)]
    assert angles[1] == pytest.approx(angles[0], abs=0.02)  # a tenth of its standard uncertainty


def test_one_stated_centre_that_is_far_off_does_not_lose_the_body_of_a_tilt(slid):
    (path,) = tracks(slid)
    far = tilted(SLIDE, Seed(100, (path[100][0] - 200, path[100][1])))
    (seen,) = tracks(far)
    assert set(seen) == set(path)
    assert value(far, "static_friction_angle", "onset") == pytest.approx(
        value(slid, "static_friction_angle", "onset"), abs=0.02
    )


def test_the_body_of_a_tilt_is_followed_on_from_a_stated_centre(slid, tmp_path):
    (path,) = tracks(slid)
    clip = covered(tmp_path / "covered.mp4", {frame: path[frame] for frame in range(104, 129)}, SLIDE)
    (without,) = tracks(tilted(clip))
    assert max(without) < 110
    (seen,) = tracks(tilted(clip, Seed(128, path[128])))
    assert seen[128] == pytest.approx(path[128], abs=0.01)
    for frame in range(129, 140):
        assert seen[frame] == pytest.approx(path[frame], abs=0.2)


@pytest.mark.parametrize(
    ("centres", "camera", "said"),
    [
        ([Seed(900, (200, 90))], {}, "--centre 900:200,90 is outside the frames"),
        ([Seed(20, (200, 90))], {"exclude": (span("10f..30f"),)}, "--centre 20:200,90 lies in a frame that --exclude"),
        ([Seed(20, (200, 90)), Seed(20, (201, 90))], {}, "--centre 20:201,90 is a second centre in this frame"),
        ([Seed(20, (5000, 90))], {}, "--centre"),
    ],
)
def test_a_centre_that_cannot_be_used_is_refused(centres, camera, said):
    with pytest.raises(BadInput, match=said):
        measured(CLIP, *centres, **camera)


def test_it_is_an_option_of_the_command_and_a_key_of_lab_toml(tmp_path, capfd):
    shutil.copy(CLIP, tmp_path)
    (tmp_path / "lab.toml").write_text(
        '[[experiments]]\nid = "drop"\nrig = "drop"\nparticle = "D6"\nwall = "steel"\nrepetitions = ["r01.mp4"]\n'
        '[experiments.camera]\ncentre = ["40:214.1,241.4", "41:214,249"]\n'
    )
    camera = read_lab(tmp_path).experiment("drop").camera
    assert camera.centre == (Seed(40, (214.1, 241.4)), Seed(41, (214.0, 249.0)))
    stated = [word for text in ("40:214.1,241.4", "41:214,249") for word in ("--centre", text)]
    assert run(["measure", "drop", str(CLIP), "--bead-diameter", "6mm", "--end", "115f", *stated, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["camera"]["stated"] == ["centre"]
