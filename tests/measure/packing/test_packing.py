"""Bed height and bulk density from constructed outlines and from drawn photos with known truth."""

import math
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.camera import FOCAL_LENGTH, Camera, known_length
from rigtwin.lab.errors import BadInput, NothingToMeasure, UnreadableMedia
from rigtwin.lab.records import Profile, write_profile
from rigtwin.measure.packing import bed_profile as packing_bed_profile
from rigtwin.measure.packing import evaluate as packing_evaluate
from rigtwin.measure.packing import measurement as packing
from rigtwin.measure.packing.cylinder import Bed, find_bed
from rigtwin.measure.packing.graduations import find_gauge

BEAD, CYLINDER = 0.006, 0.06


def outline(centres, bead=BEAD, cylinder=CYLINDER):
    """Outline of spheres seen horizontally from far away."""
    x = np.linspace(-cylinder / 2, cylinder / 2, 601)
    inside = (bead / 2) ** 2 - (x - centres[:, :1]) ** 2
    height = np.where(inside > 0, centres[:, 2:] + np.sqrt(np.maximum(inside, 0)), -np.inf).max(axis=0)
    return Profile(x, np.where(np.isfinite(height), height, np.nan), np.full(len(x), 1e-5))


def flat(height, cylinder=CYLINDER):
    """Outline that is level on average and as rough as a settled bed."""
    x = np.linspace(-cylinder / 2, cylinder / 2, 301)
    waves = 0.3 * BEAD * np.sin(2 * np.pi * x / BEAD)
    return Profile(x, height + waves, np.full(len(x), 1e-5))


def pick(result, name, method="surface bead tops"):
    return next(q for q in result.quantities if q.quantity == name and q.method == method)


# ------------------------------------------------------------------------------------------------------------ profiles


def test_the_outline_of_a_flat_bed_is_its_height():
    result = packing_evaluate.evaluate([flat(0.07)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert pick(result, "bed_height", "outline").value == pytest.approx(0.07)


@settings(max_examples=20)
@given(st.floats(0.2, 5.0))
def test_heights_scale_with_the_rig_and_the_density_does_not(size):
    rng = np.random.default_rng(1)
    centres = np.column_stack([rng.uniform(-0.027, 0.027, (300, 2)), 0.06 + 0.002 * rng.standard_normal(300)])
    mass = 0.08
    one = packing_evaluate.evaluate([outline(centres)], cylinder_diameter=CYLINDER, total_mass=mass, bead_diameter=BEAD)
    other = packing_evaluate.evaluate(
        [outline(size * centres, size * BEAD, size * CYLINDER)],
        cylinder_diameter=size * CYLINDER,
        total_mass=mass * size**3,
        bead_diameter=size * BEAD,
    )
    assert pick(other, "bed_height").value == pytest.approx(size * pick(one, "bed_height").value, rel=1e-3)
    densities = [pick(each, "bulk_density", "mean surface").value for each in (other, one)]
    assert densities[0] == pytest.approx(densities[1], rel=1e-3)


def layer(seed, count=105):
    """Centres of a rough surface layer: random heights, every two at least 0.9 bead diameters apart."""
    rng = np.random.default_rng(seed)
    places: list[np.ndarray] = []
    while len(places) < count:
        x, y = rng.uniform(-0.027, 0.027, 2)
        if math.hypot(x, y) > 0.027:
            continue
        new = np.array([x, y, 0.06 + 0.0022 * rng.standard_normal()])
        if all(np.linalg.norm(new - old) > 0.9 * BEAD for old in places):
            places.append(new)
    return np.array(places)


def test_an_outline_with_a_finger_in_front_of_it_makes_the_height_doubtful():
    smooth = outline(layer(3))
    finger = np.where(np.abs(smooth.x - 0.01) < 0.005, smooth.height + 4 * BEAD, smooth.height)
    for profile, passed in ((smooth, True), (Profile(smooth.x, finger, smooth.sigma), False)):
        result = packing_evaluate.evaluate([profile], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
        assert next(check for check in result.checks if check.check == "smooth_surface").passed == passed
        assert bool(pick(result, "bed_height").doubtful) != passed


def test_an_outline_as_straight_as_a_rod_makes_the_height_doubtful():
    x = np.linspace(-CYLINDER / 2, CYLINDER / 2, 301)
    rod = Profile(x, np.full(len(x), 0.07), np.full(len(x), 1e-5))
    result = packing_evaluate.evaluate([rod], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert "so smooth" in pick(result, "bed_height").doubtful


@pytest.mark.parametrize("share", [0.7, 1.0])
def test_the_edge_of_something_in_front_of_the_surface_is_no_bed(share):
    bed = outline(layer(3))
    in_front = bed.x < bed.x.min() + share * np.ptp(bed.x)
    edge = np.where(in_front, np.nanmean(bed.height) - 0.002 + 0.02 * bed.x, bed.height)
    result = packing_evaluate.evaluate([replace(bed, height=edge)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert "in front of it" in pick(result, "bed_height").doubtful


@pytest.mark.parametrize("seed", range(12))
def test_the_surface_of_a_bed_is_no_straight_edge(seed):
    result = packing_evaluate.evaluate([outline(layer(seed))], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert not pick(result, "bed_height").doubtful


def test_without_a_bead_size_the_roughness_is_not_checked():
    result = packing_evaluate.evaluate([outline(layer(3))], cylinder_diameter=CYLINDER)
    assert "smooth_surface" not in {check.check for check in result.checks}


@pytest.mark.slow
def test_intervals_cover_the_mean_top_of_the_surface_beads():
    inside = 0
    for seed in range(20):
        beads = layer(seed)
        apart = np.hypot(*(beads[:, None, :2] - beads[None, :, :2]).T)
        higher = beads[:, 2][:, None] > beads[:, 2][None, :]
        free = ~np.any((apart < 0.8 * BEAD) & higher, axis=0)
        truth = float(np.mean(beads[free, 2])) + BEAD / 2
        result = packing_evaluate.evaluate([outline(beads)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
        low, high = pick(result, "bed_height").interval95
        inside += low < truth < high
    assert inside >= 17


@pytest.mark.parametrize("method", ["surface bead tops", "mean surface"])
def test_bulk_density_is_mass_over_the_filled_volume(method):
    result = packing_evaluate.evaluate([flat(0.0718)], cylinder_diameter=CYLINDER, total_mass=0.1, bead_diameter=BEAD)
    height = pick(result, "bed_height", method).value
    density = pick(result, "bulk_density", method)
    assert density.value == pytest.approx(0.1 / (math.pi * 0.03**2 * height))
    assert density.std_uncertainty / density.value == pytest.approx(
        pick(result, "bed_height", method).std_uncertainty / height, rel=1e-6
    )


def test_the_bead_tops_come_first_and_lie_between_mean_surface_and_outline():
    result = packing_evaluate.evaluate([outline(layer(3))], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    heights = [one for one in result.quantities if one.quantity == "bed_height"]
    assert heights[0].method == "surface bead tops"
    values = [pick(result, "bed_height", method).value for method in ("mean surface", "surface bead tops", "outline")]
    assert values == sorted(values)


def test_several_views_are_averaged():
    result = packing_evaluate.evaluate([flat(0.070), flat(0.072)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    height = pick(result, "bed_height", "outline")
    assert height.value == pytest.approx(0.071)
    assert height.n == 2
    assert height.budget["views"] == pytest.approx(0.001)


def test_views_of_two_beds_are_not_averaged_in_silence():
    for other, passed in ((0.0705, True), (0.076, False)):
        result = packing_evaluate.evaluate([flat(0.070), flat(other)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
        assert next(check for check in result.checks if check.check == "views_agree").passed == passed
        assert all(("show the same one" in each.doubtful) != passed for each in result.quantities)


@pytest.mark.parametrize(("mass", "passed"), [(0.1, True), (1.2, True), (100.0, False), (1e-4, False)])
def test_a_mass_in_the_wrong_unit_makes_a_density_that_no_material_has(mass, passed):
    result = packing_evaluate.evaluate([flat(0.07)], cylinder_diameter=CYLINDER, bead_diameter=BEAD, total_mass=mass)
    assert ("--total-mass" in pick(result, "bulk_density").doubtful) != passed
    assert not pick(result, "bed_height").doubtful


@pytest.mark.parametrize("share", [0.1, 0.25, 1.0, 2.5])
@pytest.mark.parametrize("solid", [None, 568.0])
def test_a_mass_that_is_off_makes_a_density_that_its_beads_cannot_have(share, solid):
    mass = share * 0.6 * 568.0 * math.pi / 4 * CYLINDER**2 * 0.07
    result = packing_evaluate.evaluate(
        [flat(0.07)], cylinder_diameter=CYLINDER, bead_diameter=BEAD, total_mass=mass, bead_density=solid
    )
    doubtful = "--total-mass" in pick(result, "bulk_density").doubtful
    assert doubtful == (share != 1.0 if solid else share == 0.1)  # alone, only what no wood has is reported


def filled(fraction, *, diameter=CYLINDER, **known):
    """The density check of a bed of beads of 568 kg/m^3 that fill this share of it below the mean surface."""
    surface = 0.07 - (packing_bed_profile.OUTLINE_ABOVE + packing_evaluate.PITS_BELOW) * BEAD
    mass = fraction * 568.0 * math.pi / 4 * diameter**2 * surface
    result = packing_evaluate.evaluate(
        [flat(0.07, diameter)],
        cylinder_diameter=diameter,
        bead_diameter=BEAD,
        total_mass=mass,
        bead_density=568.0,
        **known,
    )
    check = next(check for check in result.checks if check.check == "bulk_density")
    assert check.value == pytest.approx(fraction)
    assert all((check.message.rstrip(".") in each.doubtful) != check.passed for each in result.quantities[3:])
    return check


def test_spheres_fill_what_lies_between_loose_and_close_random_packing():
    for fraction in (0.55, 0.64):
        assert filled(fraction).passed
        for wrong in (1 / 1.4, 1.4):
            check = filled(fraction * wrong)
            assert not check.passed
            assert f"--total-mass is too {'high' if wrong > 1 else 'low'} for this bed" in check.message
            assert "of other shapes" in check.message
    assert not filled(math.pi / math.sqrt(18)).passed  # a crystal


def test_a_narrow_cylinder_is_filled_more_loosely():
    assert not filled(0.46, diameter=10 * BEAD).passed
    assert filled(0.46, diameter=5.1 * BEAD).passed


def test_beads_that_are_no_spheres_may_fill_more_and_less():
    for fraction in (0.35, 0.74):
        assert filled(fraction, spheres=False).passed
    assert not filled(0.95, spheres=False).passed


def test_a_bed_of_foam_is_believed_where_its_beads_are_stated_to_be_foam():
    def reason(solid):
        mass = 0.6 * 20.0 * math.pi / 4 * CYLINDER**2 * 0.07
        result = packing_evaluate.evaluate(
            [flat(0.07)], cylinder_diameter=CYLINDER, total_mass=mass, bead_density=solid
        )
        return pick(result, "bulk_density").doubtful

    assert "--bead-density" in reason(None)
    assert not reason(20.0)


@pytest.mark.parametrize(
    ("profiles", "diameter", "message"),
    [
        ([], CYLINDER, "no profile"),
        ([flat(0.001)], CYLINDER, r"1\.0 mm above the floor, and the mean surface 3\.\d mm below it"),
        ([flat(0.07)], -1.0, "must be a positive number"),
        ([Profile(np.array([0.0]), np.array([0.07]), np.array([0.0]))], CYLINDER, "has 1 points of known height"),
    ],
)
def test_unusable_profiles_are_refused_in_a_sentence(profiles, diameter, message):
    with pytest.raises(BadInput, match=message):
        packing_evaluate.evaluate(profiles, cylinder_diameter=diameter, bead_diameter=BEAD)


# -------------------------------------------------------------------------------------------------------------- photos

PIXEL = 4.4  # [px] of a millimetre


def shade(picture, centre, radius, tone):
    for share in np.linspace(1, 0.1, 12):
        colour = tuple(int(c * tone * (1 - 0.55 * share**2)) for c in (120, 170, 205))
        cv2.circle(picture, centre, round(radius * share), colour, cv2.FILLED, cv2.LINE_AA)


def draw(path, **look):
    """Store the picture that is `drawn`; returns the mean height [m] of its outline."""
    picture, height = drawn(**look)
    cv2.imwrite(str(path), picture)
    return height


@lru_cache(maxsize=8)
def drawn(*, roll_deg=0.0, gauge=True, height=62.0, seed=2, block=0.0, beside=(), closing=0.0):
    """A cylinder of shaded beads beside a gauge, and the mean height [m] of their outline.

    The gauge stands on a `block` of that height.  `beside` are places [mm] from axis and floor of other round things.
    The walls converge by the share `closing` from the top of the bed to the floor, as in a hopper.
    """
    rng = np.random.default_rng(seed)
    zoom = 2
    picture = np.full((620 * zoom, 560 * zoom, 3), (205, 200, 192), np.uint8)
    axis, floor = 200 * zoom, 540 * zoom
    mm = PIXEL * zoom
    cv2.rectangle(picture, (0, floor), (picture.shape[1], picture.shape[0]), (150, 152, 150), cv2.FILLED)
    tops = []
    rows = np.arange(3.0, height - 2, 4.6)
    for depth in (0, 1):
        for k, row in enumerate(rows):
            for x in np.arange(-27 + 2.7 * ((k + depth) % 2), 27.1, 5.4):
                place = np.array([x + rng.uniform(-0.4, 0.4), row + rng.uniform(-0.7, 0.7)])
                if abs(x) > 27.1 - 30 * closing * (1 - row / height):
                    continue
                tops.append(place)
                centre = (round(axis + place[0] * mm), round(floor - place[1] * mm))
                tone = rng.uniform(0.85, 1.1) * (0.75 + 0.25 * depth)
                shade(picture, centre, 3 * mm, tone)
    for x, row in beside:
        shade(picture, (round(axis + x * mm), round(floor - row * mm)), 3 * mm, 1.0)
    for side in (-1, 1):
        for place, tone in ((30, 60), (32.5, 120)):
            x = round(axis + side * place * mm)
            foot = round(axis + side * place * (1 - closing) * mm)
            cv2.line(picture, (x, round(floor - height * mm)), (foot, floor), (tone, tone, tone), zoom)
            cv2.line(picture, (x, round(floor - 110 * mm)), (x, round(floor - height * mm)), (tone, tone, tone), zoom)
    if gauge:
        left = round(axis + 42 * mm)
        cv2.rectangle(picture, (left, 0), (left + round(20 * mm), floor), (170, 175, 178), cv2.FILLED)
        for k in range(0, 121):
            length = 9 if k % 10 == 0 else 6.5 if k % 5 == 0 else 4.5
            y = round((floor - (block + k) * mm) * 16)
            right = round((left + length * mm) * 16)
            cv2.line(picture, (left * 16, y), (right, y), (40, 40, 40), max(1, zoom), cv2.LINE_AA, 4)
    picture = cv2.resize(picture, None, fx=1 / zoom, fy=1 / zoom, interpolation=cv2.INTER_AREA)
    if roll_deg:
        turn = cv2.getRotationMatrix2D((280, 310), -roll_deg, 1.0)
        picture = cv2.warpAffine(picture, turn, (560, 620), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    noisy = picture + 2.5 * rng.standard_normal(picture.shape)
    centres = np.column_stack([np.array(tops)[:, 0], np.zeros(len(tops)), np.array(tops)[:, 1]]) * 1e-3
    profile = outline(centres)
    inside = np.abs(profile.x) < packing_bed_profile.READ * CYLINDER / 2
    return np.clip(noisy, 0, 255).astype(np.uint8), float(np.nanmean(profile.height[inside]))


WITHOUT_GAUGE = (
    2.5e-3  # [m], of 61 mm: walls drawn as lines of 2 px are read 1 % too far apart, the floor by the grains
)


@pytest.mark.parametrize(("gauge", "roll"), [(True, 0.0), (True, 1.5), (False, 0.0)])
def test_a_drawn_bed_is_read_off_the_gauge_or_the_cylinder(tmp_path, gauge, roll):
    photo = tmp_path / "bed.png"
    truth = draw(photo, gauge=gauge, roll_deg=roll)
    result = packing.measure(
        [photo],
        Camera(),
        cylinder_diameter=CYLINDER,
        total_mass=0.1,
        bead_diameter=BEAD,
        out=tmp_path / "out" if gauge and roll == 0 else None,
    )
    assert result.camera["scale_from"] == ("gauge" if gauge else "cylinder diameter")
    assert result.camera["scale_m_per_px"] == pytest.approx(1e-3 / PIXEL, rel=0.004 if gauge else 0.03)
    assert result.camera["camera_roll_deg"] == pytest.approx(roll, abs=0.2)
    found = pick(result, "bed_height", "outline")
    assert found.value == pytest.approx(truth, abs=0.0012 if gauge else WITHOUT_GAUGE)
    for path in result.files.values():
        assert path.stat().st_size > 0


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stated_roll_is_held_against_the_upright_edges(tmp_path, sign):
    photo = tmp_path / "bed.png"
    truth = draw(photo, roll_deg=1.5)  # clockwise
    camera = Camera(roll=math.radians(1.5 * sign))
    result = packing.measure([photo], camera, cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    (check,) = [each for each in result.checks if each.check == "camera_roll"]
    found = pick(result, "bed_height", "outline")
    assert check.passed is (sign > 0)
    assert "camera roll" in found.doubtful if sign < 0 else found.value == pytest.approx(truth, abs=0.0012)


def beside_the_wall(low):
    """Places of round things beside the cylinder, from a height [mm] up."""
    return tuple((x, row) for x in (-36.5, -42.5) for row in np.arange(low, 115, 5.7))


@pytest.mark.parametrize("gauge", [True, False])
def test_what_looks_round_beside_the_cylinder_moves_no_wall_that_else_is_seen(tmp_path, gauge):
    photo = tmp_path / "bed.png"
    truth = draw(photo, gauge=gauge, beside=beside_the_wall(72.0))
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    (walls,) = [check for check in result.checks if check.check == "walls"]
    found = pick(result, "bed_height", "outline")
    assert walls.passed
    assert not found.doubtful
    assert found.value == pytest.approx(truth, abs=0.0012 if gauge else WITHOUT_GAUGE)


def test_a_bed_beside_which_round_things_stand_as_high_is_doubtful(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo, gauge=True, beside=beside_the_wall(8.0))
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert "times the cylinder's" in found.doubtful  # the gauge's millimetre


@pytest.mark.parametrize("block", [0.0, 8.0])
def test_a_gauge_that_does_not_reach_the_floor_never_misleads_in_silence(tmp_path, block):
    photo = tmp_path / "bed.png"
    truth = draw(photo, block=block)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert bool(found.doubtful) == (block > 0)
    assert block > 0 or found.value == pytest.approx(truth, abs=0.0012)


def test_a_scale_read_off_the_beads_alone_is_as_doubtful_as_their_soft_rims(tmp_path):
    photo = tmp_path / "bed.png"
    truth = draw(photo, gauge=False)
    result = packing.measure([photo], Camera(), cylinder_diameter=None, bead_diameter=BEAD)
    assert result.camera["scale_from"] == "bead diameter"
    low, high = pick(result, "bed_height", "outline").interval95
    assert low < truth < high


def test_weighed_mass_and_gauged_diameter_have_an_uncertainty_and_those_of_a_twin_have_none(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    stated = {"cylinder_diameter": CYLINDER, "total_mass": 0.1, "bead_diameter": BEAD}
    filmed = pick(packing.measure([photo], Camera(), **stated), "bulk_density")
    exact = pick(packing_evaluate.evaluate([flat(0.07)], **stated), "bulk_density")
    # the volume scales with the square of the diameter
    assert filmed.budget["mass"] == pytest.approx(0.002 * filmed.value)
    assert filmed.budget["cylinder diameter"] == pytest.approx(2 * 0.003 * filmed.value)
    assert not {"mass", "cylinder diameter"} & set(exact.budget)


def test_a_dark_photo_gives_the_same_height(tmp_path):
    photo, dark = tmp_path / "bed.png", tmp_path / "dark.png"
    truth = draw(photo)
    picture = 0.25 * cv2.imread(str(photo)).astype(float)
    picture += 1.5 * np.random.default_rng(0).standard_normal(picture.shape)
    cv2.imwrite(str(dark), np.clip(picture, 0, 255).astype(np.uint8))
    result = packing.measure([dark], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert found.value == pytest.approx(truth, abs=0.0012)
    assert not found.doubtful


def covered(path, start, end, width, colour=(60, 60, 200)):
    """Draw a thick rod in front of the photo; places in mm from the axis and above the floor."""
    picture = cv2.imread(str(path))
    ends = [(round(200 + PIXEL * x), round(540 - PIXEL * h)) for x, h in (start, end)]
    cv2.line(picture, *ends, colour, round(PIXEL * width), cv2.LINE_AA)
    cv2.imwrite(str(path), picture)


def test_a_rod_before_the_middle_of_the_bed_leaves_its_height(tmp_path):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    covered(photo, (-60, 25), (60, 28), 14)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert found.doubtful or found.value == pytest.approx(truth, abs=0.0012)


@pytest.mark.parametrize("left", [-17, -12, 6])
def test_a_strip_of_glare_on_the_glass_does_not_divide_the_bed(tmp_path, left):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    picture = cv2.imread(str(photo))
    corners = [(round(200 + PIXEL * x), round(540 - PIXEL * h)) for x, h in ((left, 105), (left + 8, 6))]
    cv2.rectangle(picture, *corners, (255, 255, 255), cv2.FILLED)
    cv2.imwrite(str(photo), picture)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert pick(result, "bed_height", "outline").value == pytest.approx(truth, abs=0.0012)


@pytest.mark.parametrize(
    ("cylinder", "bead"), [(1.06, 1.0), pytest.param(0.9, 1.0, marks=pytest.mark.slow), (1.0, 1.3), (1.0, 0.75)]
)
def test_a_wrong_stated_size_never_misleads_in_silence(tmp_path, cylinder, bead):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    result = packing.measure(
        [photo], Camera(), cylinder_diameter=cylinder * CYLINDER, bead_diameter=bead * BEAD, total_mass=0.1
    )
    low, high = pick(result, "bed_height", "outline").interval95
    assert low < truth < high or all(each.doubtful for each in result.quantities)
    assert cylinder == 1 or pick(result, "bulk_density").doubtful


@pytest.mark.parametrize("cylinder", [pytest.param(0.5, marks=pytest.mark.slow), 0.95, 1.8, 0.1, 10.0])
def test_without_the_beads_size_the_gauge_contradicts_a_wrong_cylinder(tmp_path, cylinder):
    photo = tmp_path / "bed.png"
    draw(photo)
    result = packing.measure([photo], Camera(), cylinder_diameter=cylinder * CYLINDER, total_mass=0.1)
    said = (
        "--cylinder-diameter is wrong" if 0.45 < cylinder < 2.2 else "times the cylinder's: check --cylinder-diameter"
    )
    assert all(said in each.doubtful for each in result.quantities)
    assert not any("size not confirmed" in each for each in result.warnings)


def test_a_gauge_contradicts_a_cylinder_and_beads_that_are_stated_ten_times_too_large(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    result = packing.measure([photo], Camera(), cylinder_diameter=10 * CYLINDER, bead_diameter=10 * BEAD)
    found = pick(result, "bed_height", "outline")
    assert found.doubtful.endswith("check --cylinder-diameter and --bead-diameter")


def test_without_the_beads_size_the_right_cylinder_is_not_accused(tmp_path):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, total_mass=0.1, bead_density=1000.0)
    assert pick(result, "bed_height", "outline").value == pytest.approx(truth, abs=0.0012)
    assert not any(each.doubtful for each in result.quantities)
    (warning,) = result.warnings
    assert "bead diameter not stated" in warning


@pytest.mark.slow
def test_without_the_beads_size_the_surface_lies_half_a_bead_as_it_looks_below_the_tops(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    stated, looked = (
        packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=bead) for bead in (BEAD, None)
    )
    known, found = (pick(result, "bed_height", "mean surface") for result in (stated, looked))
    tops = pick(looked, "bed_height")
    # the apparent size of single beads differs by at most 0.16
    assert tops.value - found.value == pytest.approx(BEAD / 2, rel=0.16)
    # drawn beads look 5 % smaller than filmed ones, because none is nearer to the camera than the axis
    nearer = 0.05 * (packing_bed_profile.OUTLINE_ABOVE + packing_evaluate.PITS_BELOW) * BEAD
    assert found.value == pytest.approx(known.value, abs=2 * found.budget["bead diameter"] + nearer)
    assert found.std_uncertainty > known.std_uncertainty
    assert tops.budget["bead diameter"] / found.budget["bead diameter"] == pytest.approx(
        packing_bed_profile.OUTLINE_ABOVE / (packing_bed_profile.OUTLINE_ABOVE + packing_evaluate.PITS_BELOW)
    )
    assert any("give --bead-diameter" in warning for warning in looked.warnings)
    assert not any("bead diameter not stated" in warning for warning in stated.warnings)


@pytest.mark.slow
def test_a_size_that_nothing_checks_is_reported_as_unconfirmed(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo, gauge=False)
    alone = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, total_mass=0.1, bead_density=1000.0)
    assert "bulk density depend on --cylinder-diameter 60 mm alone" in alone.warnings[0]
    both = packing.measure(
        [photo], Camera(), cylinder_diameter=CYLINDER, total_mass=0.1, bead_density=1000.0, bead_diameter=BEAD
    )
    assert not both.warnings


def test_a_given_scale_that_the_picture_contradicts_makes_the_heights_doubtful(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    for factor in (1.0, 1.2):
        camera = Camera(scale=factor * 1e-3 / PIXEL)
        result = packing.measure([photo], camera, cylinder_diameter=CYLINDER, bead_diameter=BEAD)
        assert bool(pick(result, "bed_height").doubtful) == (factor != 1)


def test_what_stands_behind_the_cylinder_hides_nothing_of_the_surface(tmp_path):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    picture = cv2.imread(str(photo))
    surface = round(540 - PIXEL * 60)
    behind = picture[:surface, 200:250]
    clear = np.abs(behind.astype(int) - (205, 200, 192)).max(axis=2) < 20  # the wall behind, not the beads
    behind[clear] = (150, 60, 40)
    cv2.imwrite(str(photo), picture)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert found.value == pytest.approx(truth, abs=0.0012)
    assert not found.doubtful


def test_overexposed_beads_do_not_hide_their_surface(tmp_path):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    picture = cv2.imread(str(photo)).astype(float)
    behind = np.abs(picture - (205, 200, 192)).max(axis=2) < 20
    picture[picture.min(axis=2) > 75] = 255  # all of a bead but its rim
    picture[behind] = 30
    cv2.imwrite(str(photo), np.rint(picture).astype(np.uint8))
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert found.value == pytest.approx(truth, abs=0.0012)


def test_a_photo_with_black_bars_is_read_like_one_without(tmp_path):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    cv2.imwrite(str(photo), cv2.copyMakeBorder(cv2.imread(str(photo)), 0, 0, 140, 140, cv2.BORDER_CONSTANT))
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert pick(result, "bed_height", "outline").value == pytest.approx(truth, abs=0.0012)


@pytest.mark.parametrize(
    ("start", "end"),
    [((12, 61), (40, 120)), pytest.param((-60, 60), (-2, 61), marks=pytest.mark.slow), ((-60, 62), (60, 62))],
)
def test_a_rod_before_the_surface_never_misleads_in_silence(tmp_path, start, end):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    covered(photo, start, end, 16)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert found.doubtful or found.value == pytest.approx(truth, abs=0.0012)


@pytest.mark.parametrize("low", [3.5, pytest.param(5, marks=pytest.mark.slow), 8])
def test_a_rod_before_the_floor_and_the_gauge_is_no_floor(tmp_path, low):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    covered(photo, (-60, low + 8), (80, low + 8), 16)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert found.doubtful or found.value == pytest.approx(truth, abs=0.0012)


def test_a_leaning_outline_makes_the_height_doubtful():
    x = np.linspace(-CYLINDER / 2, CYLINDER / 2, 301)
    leaning = Profile(x, 0.07 + 0.2 * x, np.full(len(x), 1e-5))
    result = packing_evaluate.evaluate([leaning], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert "not level" in pick(result, "bed_height").doubtful
    level = packing_evaluate.evaluate([flat(0.07)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert pick(result, "bed_height").std_uncertainty > 2 * pick(level, "bed_height").std_uncertainty


def test_a_gauge_is_read_to_a_twentieth_of_a_millimetre():
    rows = np.arange(700)
    zero, pitch = 630.3, 4.37
    reading = (zero - rows) / pitch
    near = np.abs(reading - np.round(reading)) * pitch
    line = np.where((near < 0.7) & (reading > -0.5), 60.0, 180.0)
    picture = np.full((700, 60), 180.0)
    picture[:, 10:25] = line[:, None]
    for step, end in ((5, 32), (10, 42)):
        marks = (near < 0.7) & (np.round(reading) % step == 0) & (reading > -0.5)
        picture[marks, 10:end] = 60.0
    noisy = np.clip(picture + 8 * np.random.default_rng(0).standard_normal(picture.shape), 0, 255).astype(np.uint8)
    gauge = find_gauge(noisy, np.arange(6.0, 54.0, 2.0), np.zeros(24), 4.4, 624.0, 4.2)
    assert gauge is not None
    assert gauge.reading(630.3 - 50 * 4.37) == pytest.approx(50.0, abs=0.08)
    assert gauge.row_of(0.0) == pytest.approx(zero, abs=0.4)


def test_a_profile_table_is_a_measurement_too(tmp_path):
    table = tmp_path / "bed.csv"
    write_profile(table, flat(0.07))
    result = packing.measure([table], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert pick(result, "bed_height", "outline").value == pytest.approx(0.07)
    assert "bulk density" in result.warnings[0]


def test_a_photo_without_a_bed_says_so(tmp_path):
    photo = tmp_path / "wall.png"
    cv2.imwrite(str(photo), np.full((300, 300, 3), 180, np.uint8))
    with pytest.raises(NothingToMeasure, match=r"no bed of beads: \d+ touching circles"):
        packing.measure([photo], Camera(), cylinder_diameter=CYLINDER)
    with pytest.raises(UnreadableMedia):
        packing.measure([tmp_path / "none.png"], Camera(), cylinder_diameter=CYLINDER)
    with pytest.raises(BadInput, match="no photo"):
        packing.measure([], Camera(), cylinder_diameter=CYLINDER)


@pytest.mark.parametrize("closing", [0.0, 0.3])
def test_a_bed_between_walls_that_close_in_is_no_cylinder(tmp_path, closing):
    photo = tmp_path / "bed.png"
    draw(photo, gauge=False, closing=closing)
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    (straight,) = [each for each in result.checks if each.check == "straight_walls"]
    assert straight.passed is (closing == 0)
    assert all(("no cylinder" in one.doubtful) is (closing > 0) for one in result.quantities)


@pytest.mark.slow
def test_a_mass_that_no_stated_density_confirms_is_reported(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    given = {"cylinder_diameter": CYLINDER, "total_mass": 1.0, "bead_diameter": BEAD}
    found = [each for each in packing.measure([photo], Camera(), **given).warnings if "mass not confirmed" in each]
    assert len(found) == 1
    assert "1000 g" in found[0]
    sure = packing.measure([photo], Camera(), bead_density=700.0, **given)
    assert not any("mass not confirmed" in each for each in sure.warnings)
    assert all(one.doubtful for one in sure.quantities if one.quantity == "bulk_density")


def from_above(beads, radius, degrees, rng, *, away=math.inf):
    """Photo of beads [mm] in a cylinder of 60 mm whose floor meets the axis in row 480.

    The camera is `away` [mm] from the floor's middle, where a millimetre is PIXEL px.
    """
    zoom = 2
    picture = np.full((620 * zoom, 560 * zoom, 3), (205, 200, 192), np.uint8)
    mm, sine, cosine = PIXEL * zoom, math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    cv2.rectangle(picture, (0, 470 * zoom), (picture.shape[1], picture.shape[0]), (150, 152, 150), cv2.FILLED)
    for x, near, row in sorted(beads, key=lambda bead: bead[1] * cosine + bead[2] * sine):
        scale = mm / (1 - (near * cosine + row * sine) / away)
        centre = (round(280 * zoom + x * scale), round(480 * zoom - (row * cosine - near * sine) * scale))
        shade(picture, centre, radius * scale, rng.uniform(0.8, 1.1))
    for side in (-1, 1):
        wall = round(280 * zoom + side * 30 * mm)
        cv2.line(picture, (wall, 40 * zoom), (wall, 480 * zoom), (60, 60, 60), zoom)
    smaller = cv2.resize(picture, None, fx=1 / zoom, fy=1 / zoom, interpolation=cv2.INTER_AREA)
    return np.clip(smaller + rng.normal(0, 2, smaller.shape), 0, 255).astype(np.uint8)


def seen_from_above(degrees: float) -> np.ndarray:
    """Beads along the front of the cylinder, seen from far away."""
    rng = np.random.default_rng(3)
    beads = []
    for layer, row in enumerate(np.arange(3.0, 60.0, 5.2)):
        for k in range(28):  # beads a radius within the wall touch each other
            turn = 2 * math.pi * (k + 0.5 * (layer % 2)) / 28
            beads.append(
                (27 * math.sin(turn), 27 * math.cos(turn), row if layer == 0 else row + rng.uniform(-0.5, 0.5))
            )
    return from_above(beads, 3, degrees, rng)


@pytest.mark.parametrize("degrees", [6, 12])
def test_the_floor_lies_below_the_circle_on_which_the_outermost_beads_touch_it(degrees):
    bed = find_bed(seen_from_above(degrees), cylinder=CYLINDER, bead=BEAD)
    assert isinstance(bed, Bed)
    bead = bed.width / 10 / bed.silhouette.zoom
    assert abs(bed.floor / bed.silhouette.zoom - 480) < 0.15 * bead


def poured(count: int, rng: np.random.Generator) -> np.ndarray:
    """Centres [mm] of beads of 4 mm in the cylinder; each comes to lie on the lowest of some random places."""
    beads = np.empty((0, 3))
    for _ in range(count):
        radius, turn = 28 * np.sqrt(rng.uniform(0, 1, 60)), rng.uniform(0, 2 * math.pi, 60)
        radius[:20] = 28.0
        places = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
        apart = np.hypot(*(places[:, None] - beads[:, :2]).transpose(2, 0, 1))
        rest = np.where(apart < 4, beads[:, 2] + np.sqrt(np.maximum(16 - apart**2, 0)), 2.0)
        heights = rest.max(axis=1, initial=2.0)
        beads = np.vstack([beads, [*places[np.argmin(heights)], heights.min()]])
    return beads


def bed_from_above(degrees: float) -> tuple[np.ndarray, float]:
    """A bed of beads of 4 mm, seen by a usual lens, and the mean height [m] of its outline seen horizontally."""
    rng = np.random.default_rng(4)
    beads = poured(900, rng)
    profile = outline(1e-3 * beads, bead=0.004)
    inside = np.abs(profile.x) < packing_bed_profile.READ * CYLINDER / 2
    picture = from_above(beads, 2, degrees, rng, away=FOCAL_LENGTH * 620 / PIXEL)
    return picture, float(np.nanmean(profile.height[inside]))


@pytest.mark.parametrize("degrees", [0, 6, 11])
def test_the_far_side_of_a_bed_seen_from_above_does_not_raise_its_height(tmp_path, degrees):
    picture, truth = bed_from_above(degrees)
    cv2.imwrite(str(tmp_path / "bed.png"), picture)
    found = pick(
        packing.measure([tmp_path / "bed.png"], Camera(), cylinder_diameter=CYLINDER, bead_diameter=0.004),
        "bed_height",
        "outline",
    )
    assert not found.doubtful
    low, high = found.interval95
    assert low < truth < high
    # at 11 degrees the far side lies 2.9 bead diameters higher; the drawing lacks the shadow under the lowest beads
    assert abs(found.value - truth) < 0.25 * 0.004


def test_a_floor_outside_of_the_photo_and_walls_above_each_other_are_refused(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    with pytest.raises(BadInput, match="--floor names the row 5000, outside the picture of 560 x 620 px"):
        packing.measure([photo], Camera(floor=5000.0), cylinder_diameter=CYLINDER)
    with pytest.raises(BadInput, match=r"--cylinder: names points at .* more above than beside"):
        Camera(cylinder=((300.0, 100.0), (300.0, 500.0)))


def test_a_known_length_outside_of_the_photo_is_refused(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    camera = Camera(known_length=known_length("100 mm:5000,1,5000,900"))
    with pytest.raises(BadInput, match="5000,1, outside the picture of 560 x 620 px"):
        packing.measure([photo], camera, cylinder_diameter=CYLINDER)


def test_a_photo_that_cuts_the_bed_off_above_its_floor_makes_all_quantities_doubtful(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    cv2.imwrite(str(photo), cv2.imread(str(photo))[: round(540 - 20 * PIXEL)])
    result = packing.measure([photo], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert all("edge of the picture" in one.doubtful for one in result.quantities)


def at_the_floor():
    """Both inner walls of a drawn bed at its floor [px]."""
    return (200 - 30 * PIXEL, 540.0), (200 + 30 * PIXEL, 540.0)


def test_stated_walls_and_floor_are_used_with_their_own_uncertainty(tmp_path):
    photo = tmp_path / "bed.png"
    truth = draw(photo)
    result = packing.measure([photo], Camera(cylinder=at_the_floor()), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert result.camera["stated"] == ["cylinder"]
    assert result.camera["scale_m_per_px"] == pytest.approx(1e-3 / PIXEL, rel=1e-3)
    found = pick(result, "bed_height", "outline")
    assert found.value == pytest.approx(truth, abs=2 * found.std_uncertainty)
    assert found.budget["floor"] == pytest.approx(2e-3 / PIXEL, rel=1e-3)


@pytest.mark.parametrize(("lower", "passed"), [(0.0, True), (8e-3, False), (-12e-3, False)])
def test_a_stated_floor_is_held_against_the_foot_of_the_grains(tmp_path, lower, passed):
    photo = tmp_path / "bed.png"
    draw(photo, gauge=False)
    camera = Camera(floor=540 + lower * 1e3 * PIXEL)
    result = packing.measure([photo], camera, cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert ("the stated floor" not in found.doubtful) == passed
    assert (f"check --floor {camera.floor:g}" in found.doubtful) != passed


@pytest.mark.parametrize(("inwards", "passed"), [(0.0, True), (2.5e-3, False)])
def test_stated_walls_are_held_against_those_that_are_seen(tmp_path, inwards, passed):
    photo = tmp_path / "bed.png"
    draw(photo, gauge=False)
    (x1, y1), (x2, y2) = at_the_floor()
    walls = ((x1 + inwards * 1e3 * PIXEL, y1), (x2 - inwards * 1e3 * PIXEL, y2))
    result = packing.measure([photo], Camera(cylinder=walls), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    found = pick(result, "bed_height", "outline")
    assert ("as far apart as the stated ones" not in found.doubtful) == passed


def test_a_stated_floor_moves_the_height_by_as_much(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo)
    heights = [
        pick(
            packing.measure([photo], Camera(floor=floor), cylinder_diameter=CYLINDER, bead_diameter=BEAD),
            "bed_height",
            "outline",
        ).value
        for floor in (540.0, 550.0)
    ]
    # with a lower floor the same lowest grains mean a less steep view, which takes back a part
    assert heights[1] - heights[0] == pytest.approx(10e-3 / PIXEL, rel=0.3)


def test_a_bed_without_round_grains_is_measured_between_stated_walls(tmp_path):
    photo = tmp_path / "bed.png"
    picture = np.full((620, 560, 3), (205, 200, 192), np.uint8)
    rng = np.random.default_rng(4)
    (left, floor), (right, _) = at_the_floor()
    sand = rng.integers(60, 140, (200, int(right) - int(left)))[..., None] * np.array([0.6, 0.8, 1.0])
    picture[int(floor) - 200 : int(floor), int(left) : int(right)] = sand
    cv2.imwrite(str(photo), picture)
    result = packing.measure([photo], Camera(cylinder=at_the_floor()), cylinder_diameter=CYLINDER)
    found = pick(result, "bed_height", "outline")
    assert found.value == pytest.approx(200e-3 / PIXEL, abs=2 * found.std_uncertainty)


def test_between_stated_walls_no_circles_are_needed(tmp_path):
    photo = tmp_path / "bed.png"
    draw(photo, gauge=False)
    picture = cv2.imread(str(photo))
    left, right = at_the_floor()
    stated = {"cylinder_diameter": CYLINDER, "bead_diameter": BEAD}
    clear = pick(packing.measure([photo], Camera(cylinder=(left, right)), **stated), "bed_height", "outline")
    cv2.imwrite(str(photo), cv2.GaussianBlur(picture, (0, 0), 9))
    result = packing.measure([photo], Camera(cylinder=(left, right)), **stated)
    found = pick(result, "bed_height", "outline")
    assert not [check for check in result.checks if check.check in ("bead_size", "walls")]
    assert any("no round bead shows its size" in warning for warning in result.warnings)
    assert found.value == pytest.approx(clear.value, abs=0.3 * BEAD)


def test_what_stands_beside_and_behind_the_cylinder_is_no_wall(tmp_path):
    clear, photo = tmp_path / "clear.png", tmp_path / "bed.png"
    picture, _ = drawn(gauge=False)
    crowded = picture.copy()
    cv2.rectangle(crowded, (250, 120), (400, 255), (90, 140, 60), cv2.FILLED)  # a cup behind the empty part
    cv2.rectangle(crowded, (360, 120), (400, 540), (90, 140, 60), cv2.FILLED)
    crowded[100:540:5, 20:50] = 30  # a ruler close to the left wall
    cv2.imwrite(str(clear), picture)
    cv2.imwrite(str(photo), crowded)
    heights, scales = [], []
    for each in (clear, photo):
        result = packing.measure([each], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
        heights.append(pick(result, "bed_height", "outline").value)
        scales.append(result.camera["scale_m_per_px"])
    assert scales[1] == pytest.approx(scales[0], rel=0.02)
    assert scales[0] == pytest.approx(1e-3 / PIXEL, rel=0.02)
    assert heights[1] == pytest.approx(heights[0], abs=0.15 * BEAD)
