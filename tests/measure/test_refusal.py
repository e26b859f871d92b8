"""Every rig leaves a picture of what was seen where it refuses a film or photo."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

import rigtwin
from rigtwin.lab.camera import Camera, KnownLength, Seed
from rigtwin.lab.errors import BadInput, NothingToMeasure, Seen
from rigtwin.lab.quantity import Measurement
from rigtwin.measure import refusal

RIGS = {
    "drop": {"bead_diameter": "6 mm"},
    "pendulum": {"variant": "double", "length": "200 mm"},
    "tilt": {"variant": "slide"},
    "drum": {"drum_diameter": "250 mm", "speed": "10 rpm"},
    "hopper": {"bin_width": "200 mm"},
}
PHOTOS = {"pile": {}, "packing": {"cylinder_diameter": "100 mm"}}


@pytest.fixture(scope="module")
def film(tmp_path_factory) -> Path:
    """A dot that goes round in circles before noise: no rig shows that."""
    path = tmp_path_factory.mktemp("film") / "circling.avi"
    rng = np.random.default_rng(5)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, (320, 240))
    for index in range(41):  # once around
        picture = np.full((240, 320, 3), 120.0) + rng.normal(0, 2, (240, 320, 1))
        turn = 2 * math.pi * index / 40
        cv2.circle(picture, (round(160 + 60 * math.cos(turn)), round(120 + 60 * math.sin(turn))), 8, (30, 30, 30), -1)
        writer.write(np.clip(picture, 0, 255).astype(np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize("rig", RIGS)
def test_a_refused_film_leaves_a_picture_that_the_message_names(rig, film, tmp_path):
    with pytest.raises(NothingToMeasure) as refused:
        rigtwin.measure(rig, film, out=tmp_path, **RIGS[rig])
    picture = tmp_path / "circling-seen.png"
    assert str(refused.value).startswith(f"{film}: ")
    assert str(refused.value).endswith(f"; {picture} shows what was seen.")
    assert [file.name for file in tmp_path.iterdir()] == [picture.name]
    shown = cv2.imread(str(picture))
    # the reason stands below the frame
    assert shown.shape[1] >= 700
    assert shown.shape[0] > shown.shape[1] * 240 / 320
    # what changes is outlined in blue, along the circle that the dot runs through
    blue = (shown[..., 0].astype(int) - shown[..., 2]) > 60
    rows, columns = np.nonzero(blue[: round(shown.shape[1] * 240 / 320)])
    zoom = shown.shape[1] / 320
    assert np.abs(columns / zoom - 160).max() == pytest.approx(68, abs=5)
    assert np.abs(rows / zoom - 120).max() == pytest.approx(68, abs=5)


@pytest.mark.parametrize("rig", ["drop", "hopper"])
def test_a_refused_film_that_is_cut_off_is_first_said_to_be(rig, film, tmp_path):
    cut = tmp_path / "cut.avi"
    cut.write_bytes(film.read_bytes()[: film.stat().st_size // 3])
    with pytest.raises(NothingToMeasure) as refused:
        rigtwin.measure(rig, cut, **RIGS[rig])
    assert str(refused.value).startswith(f"{cut}: the file is shorter than its header states")
    assert str(refused.value).count(str(cut)) == 1


@pytest.mark.parametrize("rig", PHOTOS)
def test_a_refused_photo_leaves_a_picture_that_the_message_names(rig, tmp_path):
    photo = tmp_path / "noise.png"
    cv2.imwrite(str(photo), np.random.default_rng(1).normal(120, 5, (300, 400)).astype(np.uint8))
    with pytest.raises(NothingToMeasure) as refused:
        rigtwin.measure(rig, photo, out=tmp_path / "out", **PHOTOS[rig])
    picture = tmp_path / "out" / "noise-seen.png"
    assert str(refused.value).endswith(f"; {picture} shows what was seen.")
    assert cv2.imread(str(picture)).shape[1] >= 700


def test_a_refusal_of_another_medium_than_those_given_is_not_lost(tmp_path):
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.full((300, 400), 120, np.uint8))

    @refusal.shows_refusals
    def measure(photos, cameras, *, out):
        raise NothingToMeasure("there is no heap.", Seen(medium=other))

    with pytest.raises(NothingToMeasure, match=r"^there is no heap; .*other-seen.png shows what was seen.$"):
        measure([tmp_path / "a.png", tmp_path / "b.png"], [Camera(), Camera()], out=tmp_path)


def test_stated_places_are_drawn_in_the_picture_of_a_refusal(tmp_path):
    photo = tmp_path / "noise.png"
    cv2.imwrite(str(photo), np.random.default_rng(1).normal(120, 5, (600, 800)).astype(np.uint8))

    def yellow() -> int:
        shown = cv2.imread(str(tmp_path / "noise-seen.png")).astype(int)
        return int(np.sum((shown[:600, :, 2] - shown[:600, :, 0] > 80) & (shown[:600, :, 1] - shown[:600, :, 0] > 80)))

    with pytest.raises(NothingToMeasure):
        rigtwin.measure("packing", photo, out=tmp_path, cylinder_diameter="100 mm")
    without = yellow()
    with pytest.raises(NothingToMeasure):
        rigtwin.measure("packing", photo, out=tmp_path, cylinder_diameter="100 mm", region="100,100,500,400")
    assert yellow() - without > 4 * 400


def test_every_stated_place_has_a_mark():
    ends = ((10.0, 20.0), (90.0, 20.0))
    places = {"plate": ends, "base": ends, "cylinder": ends, "slot": ends, "pivots": ends, "floor": 20.0}
    camera = Camera(
        **places, known_length=KnownLength(0.1, *ends), circle=(50.0, 50.0, 40.0), bead_at=Seed(3, (10.0, 20.0))
    )
    marked = {mark.label: mark for mark in refusal._stated(camera)}
    assert {label.partition(",")[0] for label in marked} == {f"--{name}".removesuffix("s") for name in places} | {
        "--circle", "--bead-at", "--known-length"
    }  # fmt: skip
    assert len(marked["--floor"].points) == 2
    assert marked["--known-length"].points == ends


def test_a_measurement_removes_the_picture_of_an_earlier_refusal(tmp_path):
    photo = Path(rigtwin.__file__).parent / "sample_media" / "pile" / "view1.jpg"
    left = tmp_path / f"{photo.stem}-seen.png"
    left.write_bytes(b"")
    rigtwin.measure("pile", photo, out=tmp_path)
    assert not left.exists()


@pytest.mark.parametrize(
    ("rig", "place", "option"),
    [
        ("drum", {"circle": "100,100,60"}, 'circle="100,100,60"'),
        ("drop", {"plate": "20,200,300,201"}, 'plate="20,200,300,201"'),
    ],
)
def test_a_refusal_names_what_was_stated_with_its_value(rig, place, option, film, tmp_path):
    with pytest.raises(NothingToMeasure) as refused:
        rigtwin.measure(rig, film, out=tmp_path, **RIGS[rig], **place)
    assert f"used as stated: {option}; what is left out is searched" in refused.value.message


@pytest.mark.parametrize(("why", "named"), [("--floor 100 is none.", 100.0), ("nothing lies on --floor 10.", 10.0)])
def test_a_stated_value_is_neither_named_twice_nor_missed_beside_one_that_begins_alike(why, named, tmp_path):
    photo = tmp_path / "noise.png"
    cv2.imwrite(str(photo), np.full((300, 400), 120, np.uint8))

    @refusal.shows_refusals
    def measure(photos, camera):
        raise NothingToMeasure(why)

    for floor in (10.0, 100.0):
        with pytest.raises(NothingToMeasure) as refused:
            measure([photo], Camera(floor=floor))
        assert (f"used as stated: --floor {floor:g};" in refused.value.message) == (floor != named)


def test_a_bead_larger_than_its_drum_is_refused_with_both_sizes(film):
    with pytest.raises(BadInput, match=r"a bead of 60 mm \(bead_diameter\) .* drum of 15 mm \(drum_diameter\)"):
        rigtwin.measure("drum", film, drum_diameter="15 mm", speed="4 rpm", bead_diameter="60 mm")


BASE, OTHER = ((100.0, 300.0), (400.0, 300.0)), ((90.0, 300.0), (400.0, 300.0))


@pytest.mark.parametrize(
    ("bases", "named"),
    [
        ([BASE, BASE], "--base 100,300,400,300"),
        ([BASE, None], "--base"),
        ([None, BASE], "--base"),
        ([BASE, OTHER], "--base"),
    ],
)
def test_a_reason_has_the_value_of_a_place_that_every_photo_states(bases, named, tmp_path):
    photos = [tmp_path / "view1.png", tmp_path / "view2.png"]

    @refusal.shows_refusals
    def measure(media, cameras):
        return Measurement("pile", media[0], "", (), warnings=("view2: no base was found; --base states it",))

    found = measure(photos, [Camera(base=base) for base in bases])
    assert found.warnings == (f"view2: no base was found; {named} states it",)


@pytest.mark.parametrize("rig", ["hopper", "measure tilt"])
def test_a_refusal_that_names_the_rig_alone_names_the_film_instead(rig, film):
    @refusal.shows_refusals
    def nothing(_film, _camera):
        raise NothingToMeasure(f"{rig}: in no two frames in a row anything moves.")

    with pytest.raises(NothingToMeasure) as refused:
        nothing(film, Camera())
    assert str(refused.value) == f"{film}: in no two frames in a row anything moves."
