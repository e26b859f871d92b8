"""Pictures show beads at their positions, near ones in front of far ones, and walls as translucent."""

import math

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track
from rigtwin.sim.output.picture import draw, slab, strobe

PAPER = [255, 255, 255]
RED, BLUE = [255, 0, 0], [0, 0, 255]
SQUARE = np.array([[[-1, 0, -1], [1, 0, -1], [1, 0, 1]], [[-1, 0, -1], [1, 0, 1], [-1, 0, 1]]], dtype=float)


def inked(image) -> np.ndarray:
    return (image != PAPER).any(axis=2)


def reddish(image) -> np.ndarray:
    return inked(image) & (image[..., 2] == 0)


def test_one_bead_is_a_disc_in_the_middle_that_fills_the_picture():
    image = draw(np.array([[0.3, -2, 7]]), np.array([0.003]), width=400, height=200)
    rows, columns = np.nonzero(inked(image))
    assert image.shape == (200, 400, 3)
    assert (rows.mean() + 0.5, columns.mean() + 0.5) == pytest.approx((100, 200), abs=1)
    assert np.ptp(rows) + 1 == np.ptp(columns) + 1 == pytest.approx(184, abs=2)  # 4 % of the height above and below
    assert len(rows) == pytest.approx(math.pi * 92**2, rel=0.02)


def test_the_light_comes_from_the_upper_left():
    image = draw(np.array([[0, 0, 0]]), np.array([1.0]), width=200, height=200).sum(axis=2)
    assert image[60, 60] > image[100, 100] > image[140, 140]


def test_up_is_up_and_right_is_right():
    beads = np.array([[0, 0, 0], [0, 0, 6], [8, 0, 0]], dtype=float)  # looking along y
    image = draw(
        beads, np.full(3, 0.5), turn=0, tilt=0, colours=np.array([[1, 1, 1], RED, BLUE]), width=300, height=300
    )
    red, blue = np.argwhere(reddish(image)), np.argwhere(inked(image) & (image[..., 0] == 0))
    dark = np.argwhere(inked(image) & (image.max(axis=2) < 5))
    assert red[:, 0].mean() < dark[:, 0].mean() - 100
    assert red[:, 1].mean() == pytest.approx(dark[:, 1].mean(), abs=2)
    assert blue[:, 1].mean() > dark[:, 1].mean() + 100


@pytest.mark.parametrize(("turn", "seen"), [(0, "red"), (180, "blue")])
def test_the_near_bead_hides_the_far_one_whatever_their_order(turn, seen):
    beads = np.array([[0, 0, 0], [0, 3, 0]], dtype=float)
    colours = np.array([RED, BLUE])
    for order in ([0, 1], [1, 0]):
        image = draw(beads[order], np.ones(2), turn=turn, tilt=0, colours=colours[order])
        assert reddish(image).any() == (seen == "red")
        assert (inked(image) & ~reddish(image)).any() == (seen == "blue")


def test_a_wall_dims_beads_behind_it_and_not_those_in_front():
    looks = {}
    for y in (-2.0, 2.0):
        bead = np.array([[0, y, 0]])
        looks[y] = draw(bead, np.array([0.3]), walls=SQUARE, turn=0, tilt=0, width=200, height=200)
    bare = draw(np.array([[0, -2.0, 0]]), np.array([0.3]), walls=SQUARE[:0], turn=0, tilt=0, width=200, height=200)
    assert looks[-2.0][100, 100].tolist() == pytest.approx(bare[100, 100].tolist(), abs=4)
    assert looks[2.0][100, 100].tolist() != pytest.approx(bare[100, 100].tolist(), abs=12)
    corner = looks[2.0][20, 20]
    assert (corner < 255).all()
    assert np.array_equal(corner, looks[2.0][180, 20])  # two triangles, one even veil


def test_an_empty_picture_is_refused():
    with pytest.raises(BadInput, match="nothing to draw"):
        draw(np.zeros((0, 3)), np.zeros(0))


def test_strobe_images_end_on_the_plate():
    time = np.linspace(0, 1, 50)
    fall = Track(time, np.stack([0 * time, 6 - 5 * time], axis=1), np.full(50, 1e-3), "A")
    image = strobe([fall], [1.0], walls=slab((-2, -1), (2, 0)))
    veil = inked(image) & (image.min(axis=2) > 200)  # light grey; beads are brown
    beads = np.flatnonzero((inked(image) & ~veil).any(axis=1))
    plate = np.flatnonzero(veil.sum(axis=1) > 100)
    assert np.ptp(beads) + 1 == pytest.approx(7 * (np.ptp(plate) + 1), abs=3)  # seven units above one
    assert beads.max() + 1 == pytest.approx(plate.min(), abs=2)


def test_a_clump_is_drawn_sphere_by_sphere():
    still = Track(np.array([0.0, 1.0]), np.zeros((2, 2)), np.full(2, 1e-3), "A")
    image = strobe([still], [1.0, 1.0], [(-2.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    middle = inked(image)[image.shape[0] // 2]
    edges = np.flatnonzero(np.diff(middle.astype(int)))
    across = np.diff(edges)
    assert len(edges) == 4
    assert across == pytest.approx([across[0]] * 3, abs=2)  # bead, gap, bead: two wide each


def test_a_turned_slab_rises_to_the_right():
    corners = slab((0, -0.1), (2, 0), turned=math.radians(30)).reshape(-1, 3)
    top = corners[np.argmax(corners[:, 2])]
    assert top == pytest.approx([math.sqrt(3), 0, 1])
