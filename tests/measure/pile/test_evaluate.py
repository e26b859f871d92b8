"""Evaluation of profiles of a heap: every part of the budgets, in closed form where there is one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import weibull_min

from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.quantity import Check, Evaluation, Quantity
from rigtwin.lab.records import Profile
from rigtwin.measure.pile import repose_angles
from rigtwin.measure.pile.evaluate import Observation, evaluate, evaluate_views

GRAPHICAL, GEOMETRIC = "angle_of_repose_graphical", "angle_of_repose_geometric"
LINE, NARROWER, STEEPEST = "line 15-85 %", "line 20-80 %", "steepest third"
GRAIN, HEIGHT = 0.002, 0.03
WIDE = 2 * HEIGHT / math.tan(math.radians(30))  # [m], of a heap of 30 degrees


def heap(left: float = 30.0, right: float = 30.0, *, height: float = HEIGHT, view: str = "front") -> Profile:
    """A triangle of two slopes [deg] with bumps a grain apart."""
    feet = [height / math.tan(math.radians(slope)) for slope in (left, right)]
    x = np.linspace(-feet[0], feet[1], 2001)
    surface = np.where(x < 0, height * (1 + x / feet[0]), height * (1 - x / feet[1]))
    bumps = 0.15 * GRAIN * np.sin(2 * np.pi * x / GRAIN) * np.clip(surface / (3 * GRAIN), 0, 1)
    return Profile(x, surface + np.where(surface < 0.97 * height, bumps, 0), np.zeros(len(x)), view=view)


def pick(found: Evaluation, quantity: str, method: str = "", side: str = "", view: str = "") -> Quantity:
    (one,) = (
        each for each in found.quantities
        if each.quantity == quantity and method in ("", each.method)
        and side in ("", each.detail.get("side")) and view in ("", each.detail.get("view"))
    )  # fmt: skip
    return one


def parts_of(profile: Profile, base: float | None = None, grain: float | None = GRAIN) -> repose_angles.Heap:
    parts = repose_angles.find_parts(profile, base, grain)
    assert parts is not None
    return parts


def seen(*profiles: Profile, base: float | None = None, bead: float | None = GRAIN, **more: object) -> Evaluation:
    return evaluate_views([Observation(one, **more) for one in profiles], base, bead)  # type: ignore[arg-type]


def summit(tangent: float) -> float:
    """Standard deviation [grains] of the depth of the highest grain: the first of a Poisson process in a cone."""
    per_volume = 0.6 / (math.pi / 6)
    return float(weibull_min(3, scale=(3 * tangent**2 / (math.pi * per_volume)) ** (1 / 3)).std())


def test_every_definition_is_listed_once_and_the_line_comes_first() -> None:
    found = evaluate([heap()], bead_diameter=GRAIN)
    listed = [(one.quantity, one.method, one.detail.get("side")) for one in found.quantities]
    assert listed == [
        (GRAPHICAL, LINE, "left"), (GRAPHICAL, LINE, "right"), (GRAPHICAL, LINE, "mean"),
        (GEOMETRIC, "apex", "left"), (GEOMETRIC, "apex", "right"), (GEOMETRIC, "apex", "mean"),
        (GEOMETRIC, "equal area", "mean"),
        (GRAPHICAL, NARROWER, "left"), (GRAPHICAL, NARROWER, "right"), (GRAPHICAL, NARROWER, "mean"),
        (GRAPHICAL, STEEPEST, "left"), (GRAPHICAL, STEEPEST, "right"),
        ("pile_height", "95 % of the top grain band", None), ("pile_base_width", "outermost outline points", None),
        ("pile_tip_radius", "parabola through the tip", None),
    ]  # fmt: skip
    for one in found.quantities:
        assert one.unit == ("deg" if "angle" in one.quantity else "m")
        assert one.n == 1
        assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))
        assert not one.doubtful
    assert not found.warnings


def test_a_lines_budget_is_its_roughness_and_window_and_half_of_both_sides_in_the_mean() -> None:
    profile = heap(28, 33)
    parts, found = parts_of(profile), evaluate([profile], bead_diameter=GRAIN)
    rough, window = (
        [of(parts, side) for side in ("left", "right")]
        for of in (repose_angles.roughness_uncertainty, repose_angles.window_uncertainty)
    )
    assert min(*rough, *window) > 0
    for method in (LINE, NARROWER):
        for k, side in enumerate(("left", "right")):
            one = pick(found, GRAPHICAL, method, side)
            assert one.value == pytest.approx((28, 33)[k], abs=0.3)
            assert one.budget == pytest.approx({"grain roughness": rough[k], "window of the line": window[k]})
        mean = pick(found, GRAPHICAL, method, "mean")
        left, right = (pick(found, GRAPHICAL, method, side).value for side in ("left", "right"))
        assert mean.value == pytest.approx((left + right) / 2)
        assert mean.budget == pytest.approx(
            {"grain roughness": math.hypot(*rough) / 2, "window of the line": math.hypot(*window) / 2}
        )
        assert mean.detail == {"side": "mean", "left_minus_right_deg": pytest.approx(left - right, abs=1e-4)}


def test_a_geometric_angle_is_uncertain_by_the_grains_at_apex_and_foot() -> None:
    profile = heap(28, 33)
    parts, found = parts_of(profile), evaluate([profile], bead_diameter=GRAIN)
    for method in ("apex", "equal area"):
        one = pick(found, GEOMETRIC, method, "mean")
        tangent = math.tan(math.radians(one.value))
        turned = summit(tangent) * GRAIN / (parts.base_width / 2) / (1 + tangent**2)
        assert one.budget == pytest.approx({"grain at apex and foot": math.degrees(turned)})
        assert one.detail == {"side": "mean", "base_limited": False}
    for k, side in enumerate(("left", "right")):
        one = pick(found, GEOMETRIC, "apex", side)
        tangent, reach = math.tan(math.radians(one.value)), abs(parts.apex[0] - parts.feet[k])
        grains = math.hypot(summit(tangent), 0.25 * tangent) * GRAIN / reach / (1 + tangent**2)
        place = tangent / (1 + tangent**2) * parts.apex_spread / reach
        assert one.budget == pytest.approx(
            {"grain at apex and foot": math.degrees(grains), "place of the apex": math.degrees(place)}
        )


def test_a_stated_base_adds_the_error_of_the_scale_to_the_angle_over_it() -> None:
    profile, step = heap(), 0.03
    found = seen(profile, base=WIDE, scale_uncertainty=step)
    for method, power in (("apex", 1), ("equal area", 2)):  # the height over the base, the area over its square
        one = pick(found, GEOMETRIC, method, "mean")
        tangent = math.tan(math.radians(one.value))
        moved = math.atan(tangent * (1 + 1e-4 * step) ** power) - math.atan(tangent)
        assert one.budget["scale"] == pytest.approx(math.degrees(moved) / 1e-4, rel=1e-3)
        assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))
    for one in found.quantities:
        if one.unit == "deg" and (one.quantity == GRAPHICAL or one.detail["side"] != "mean"):
            assert "scale" not in one.budget
    in_picture = replace(profile, base=(-WIDE / 2, WIDE / 2))
    for other in (seen(in_picture, base=WIDE, scale_uncertainty=step), seen(profile, scale_uncertainty=step)):
        assert "scale" not in pick(other, GEOMETRIC, "apex", "mean").budget


def test_other_readings_of_a_photo_add_the_root_mean_square_of_their_changes() -> None:
    profile = heap()
    edge = (heap(31, 31), heap(28, 28))
    found = seen(profile, variants={"edge": edge})
    usual = evaluate([profile], bead_diameter=GRAIN)
    readings = [evaluate([one], bead_diameter=GRAIN) for one in edge]
    for method, quantity in ((LINE, GRAPHICAL), ("apex", GEOMETRIC), ("equal area", GEOMETRIC)):
        one = pick(found, quantity, method, "mean")
        changes = [pick(each, quantity, method, "mean").value - one.value for each in readings]
        assert one.value == pick(usual, quantity, method, "mean").value
        assert one.budget["edge"] == pytest.approx(math.sqrt((changes[0] ** 2 + changes[1] ** 2) / 2))
        assert one.budget["edge"] == pytest.approx(math.sqrt((1 + 4) / 2), abs=0.15)
    # a reading that shows no heap changes nothing
    nothing = replace(profile, height=np.zeros(len(profile.x)))
    half = pick(seen(profile, variants={"edge": (nothing, edge[1])}), GRAPHICAL, LINE, "mean")
    assert half.budget["edge"] == pytest.approx(2 / math.sqrt(2), abs=0.15)


def test_lengths_are_uncertain_by_a_quarter_of_a_grain_scale_and_outline() -> None:
    profile, taller = heap(), (heap(height=0.031), heap(height=0.027))
    found = seen(profile, scale_uncertainty=0.02, variants={"edge": taller})
    parts = parts_of(profile)
    height, width, radius = (pick(found, f"pile_{name}") for name in ("height", "base_width", "tip_radius"))
    assert height.value == pytest.approx(parts.apex[1])
    assert width.value == pytest.approx(WIDE, rel=1e-3)
    apexes = [parts_of(one).apex[1] for one in taller]
    assert height.budget == pytest.approx(
        {"grain at apex and foot": GRAIN / 4, "scale": 0.02 * height.value,
         "outline and base line": abs(apexes[0] - apexes[1]) / 2}
    )  # fmt: skip
    assert width.budget == pytest.approx({"grain at apex and foot": GRAIN / 4, "scale": 0.02 * width.value})
    assert radius.budget == pytest.approx({"grain roughness": 0.3 * radius.value, "scale": 0.02 * radius.value})
    plain = evaluate([profile], bead_diameter=GRAIN)
    assert pick(plain, "pile_height").budget == pytest.approx({"grain at apex and foot": GRAIN / 4})


def test_the_tip_of_a_parabola_has_its_radius() -> None:
    x = np.linspace(-0.06, 0.06, 1201)
    round_tip = Profile(x, 0.03 - x**2 / (2 * 0.06), np.zeros(len(x)))
    assert pick(evaluate([round_tip], bead_diameter=GRAIN), "pile_tip_radius").value == pytest.approx(0.06, rel=0.01)


@pytest.mark.parametrize(
    ("stated", "as_seen", "grain"), [(0.002, 1.5, 0.003), (None, 1.0, 0.0016), (0.002, None, 0.002)]
)
def test_a_grain_is_as_large_as_it_looks_where_that_contradicts_what_is_stated(
    stated: float | None, as_seen: float | None, grain: float
) -> None:
    checks = () if as_seen is None else (Check("bead_size", as_seen == 1.0, as_seen, 1.0, "beads look larger."),)
    found = seen(heap(), bead=stated, grain=0.0016, checks=checks)
    assert pick(found, "pile_height").budget["grain at apex and foot"] == pytest.approx(grain / 4)
    assert bool(pick(found, "pile_height").doubtful) == (as_seen == 1.5)
    assert not pick(found, GRAPHICAL, LINE, "mean").doubtful
    assert found.checks == checks


def test_without_a_bead_a_tenth_of_the_height_is_its_grain() -> None:
    height = pick(evaluate([heap()]), "pile_height")
    assert height.budget["grain at apex and foot"] == pytest.approx(0.1 * HEIGHT / 4, rel=0.02)


def test_an_unreliable_outline_costs_three_degrees_and_a_grain() -> None:
    sound = seen(heap())
    found = seen(heap(), flaw="the tip is hidden")
    for before, one in zip(sound.quantities, found.quantities, strict=True):
        assert one.doubtful == "the tip is hidden"
        assert one.budget == pytest.approx(before.budget | {"unreliable outline": 3.0 if one.unit == "deg" else GRAIN})
    unsure = seen(heap(), unsure_base="its rim is hidden")
    for before, one in zip(sound.quantities, unsure.quantities, strict=True):
        assert one.doubtful == ("" if one.quantity == GRAPHICAL else "its rim is hidden")
        assert ("unreliable outline" in one.budget) == (one.quantity != GRAPHICAL)
        assert one.value == before.value


def test_failed_checks_of_roll_and_sizes_make_sides_and_lengths_doubtful() -> None:
    leaning = seen(heap(), checks=(Check("camera_roll", False, 2.0, 0.0, "the camera leans."),))
    for one in leaning.quantities:
        assert bool(one.doubtful) == (one.detail.get("side") in ("left", "right"))
    wrong = seen(heap(), checks=(Check("base_diameter", False, 0.1, 0.12, "the base is narrower."),))
    for one in wrong.quantities:
        assert bool(one.doubtful) == (one.unit == "m")


@pytest.mark.parametrize(
    ("across", "reason"),
    [
        (1.0, ""),
        (0.92, ""),
        (0.88, "the heap covers 88 % of the stated base, so its geometric angle is too small; "
               "pour until it reaches the rim, or correct the base if it does"),
    ],
)  # fmt: skip
def test_a_heap_must_cover_nine_tenths_of_a_stated_base(across: float, reason: str) -> None:
    found = evaluate([heap()], base_diameter=WIDE / across, bead_diameter=GRAIN)
    for one in found.quantities:
        assert one.doubtful == (reason if one.quantity == GEOMETRIC and one.detail["side"] == "mean" else "")
        if one.quantity == GEOMETRIC:
            assert one.detail["base_limited"] is (across == 1.0)


@pytest.mark.parametrize(("grains", "too_wide"), [(2.7, False), (3.3, True)])
def test_a_heap_hangs_over_its_base_by_three_grains_at_most(grains: float, too_wide: bool) -> None:
    base = WIDE - grains * GRAIN
    found = evaluate([heap()], base_diameter=base, bead_diameter=GRAIN)
    reason = (
        f"the heap is {WIDE / base:.2f} times as wide as its base, more than beads can overhang: "
        "an end of the base line or the base's diameter is wrong"
    )
    assert pick(found, GEOMETRIC, "apex", "mean").doubtful == (reason if too_wide else "")
    assert pick(found, GEOMETRIC, "apex", "left").doubtful == ""


@pytest.mark.parametrize(
    ("left", "right", "limited"), [(0.8, 0.8, True), (1.2, 0.8, False), (0.8, 1.2, False), (-0.8, -0.8, True)]
)
def test_a_heap_is_limited_by_a_base_in_the_picture_that_it_reaches_within_a_grain(
    left: float, right: float, limited: bool
) -> None:
    base = (-WIDE / 2 - left * GRAIN, WIDE / 2 + right * GRAIN)
    found = evaluate([replace(heap(), base=base)], base_diameter=0.1, bead_diameter=GRAIN)
    assert pick(found, GEOMETRIC, "apex", "mean").detail["base_limited"] is limited
    angle = math.degrees(math.atan(2 * parts_of(heap()).apex[1] / (base[1] - base[0])))
    assert pick(found, GEOMETRIC, "apex", "mean").value == pytest.approx(angle)


@pytest.mark.parametrize(("across", "remarked"), [(1.0, False), (0.96, True), (1.06, True)])
def test_a_mean_by_a_stated_base_beside_both_of_its_sides_is_remarked(across: float, remarked: bool) -> None:
    said = [words for words in evaluate([heap()], base_diameter=across * WIDE).warnings if "the mean, " in words]
    assert len(said) == remarked
    if remarked:
        mean = pick(evaluate([heap()], base_diameter=across * WIDE), GEOMETRIC, "apex", "mean").value
        assert said[0].startswith(
            f"geometric angle of repose: the mean, {mean:.1f} deg, is that of the width of the base"
        )


@pytest.mark.parametrize(("grains", "limited"), [(1.8, True), (2.2, False)])
def test_a_heap_is_limited_by_a_stated_base_that_is_two_grains_wider(grains: float, limited: bool) -> None:
    found = evaluate([heap()], base_diameter=WIDE + grains * GRAIN, bead_diameter=GRAIN)
    assert pick(found, GEOMETRIC, "apex", "left").detail["base_limited"] is limited


@pytest.mark.parametrize(
    ("profile", "grain", "reason"),
    [
        (heap(70, 30), GRAIN, "the left flank has 70 deg, steeper than a loose heap: something hides or adds to it"),
        (heap(30, 70), GRAIN, "the right flank has 70 deg, steeper than a loose heap: something hides or adds to it"),
        (heap(), 0.014, "the left flank is only 2.6 grains long"),
        (heap(), 0.011, ""),
    ],
)
def test_a_flank_that_no_heap_has_is_named_with_its_number(profile: Profile, grain: float, reason: str) -> None:
    found = evaluate_views([Observation(profile, flank="both")], None, grain)
    assert {one.doubtful for one in found.quantities} == {reason}


def test_a_flank_that_goes_up_and_down_is_named() -> None:
    waves = 0.006 * np.sin(heap().x / 0.0015)
    for side, where in (("left", heap().x < -0.004), ("right", heap().x > 0.004)):
        rough = replace(heap(), height=np.clip(heap().height + np.where(where, waves, 0), 0, HEIGHT))
        found = seen(rough)
        assert {one.doubtful for one in found.quantities} == {f"the {side} flank does not fall steadily"}


def test_a_flank_against_a_wall_is_left_out_with_a_warning() -> None:
    wall = heap()
    cut = replace(
        wall, x=wall.x[wall.x > -0.004], height=wall.height[wall.x > -0.004], sigma=wall.sigma[wall.x > -0.004]
    )
    found = evaluate([cut], bead_diameter=GRAIN)
    assert {one.detail["side"] for one in found.quantities if one.unit == "deg"} == {"right"}
    warning = (
        "only the right flank is measured: the other is steeper than a loose heap, as against a wall; "
        "give --flank both if it is a slope."
    )
    assert warning in found.warnings
    stated = seen(cut, flank="right")
    assert {one.detail["side"] for one in stated.quantities if one.unit == "deg"} == {"right"}
    assert warning not in stated.warnings


def test_a_flank_too_short_for_a_line_is_named() -> None:
    # the left flank is a vertical step between two of the 800 points of a profile
    x = np.array([0.0, *np.linspace(1e-6, 0.05, 100)])
    short = Profile(x, np.where(x == 0, 0.0, 0.03 * (1 - x / 0.05)), np.zeros(len(x)))
    found = evaluate_views([Observation(short, flank="both")], None, GRAIN)
    reason = "the left flank is too short to fit a line"
    assert {one.doubtful for one in found.quantities} == {reason}
    assert f"graphical angle of repose: not given, because {reason}." in found.warnings
    assert not any(one.quantity == GRAPHICAL and one.detail["side"] in ("left", "mean") for one in found.quantities)


SLOPES = ((29.0, 31.0), (28.0, 30.0), (30.0, 33.0))


def three_views() -> list[Profile]:
    return [heap(*pair, view=f"view {k}") for k, pair in enumerate(SLOPES)]


def combined(values: Sequence[Quantity], parts: Sequence[str]) -> dict[str, float]:
    """Budget of a mean over views: the scatter, and the mean of what they share."""
    spread = float(np.std([one.value for one in values], ddof=1))
    shared = {part: float(np.mean([one.budget[part] for one in values])) for part in parts}
    return shared | {"scatter of views and sides": spread / math.sqrt(len(values))}


def test_means_over_views_have_the_scatter_and_what_the_views_share() -> None:
    found = evaluate(three_views(), bead_diameter=GRAIN)
    singles = [one for one in found.quantities if one.detail["view"] != "all"]
    assert {one.detail["view"] for one in singles} == {"view 0", "view 1", "view 2"}
    for quantity, method, parts, sides in (
        (GRAPHICAL, LINE, ("window of the line",), ("left", "right")),
        (GEOMETRIC, "apex", ("grain at apex and foot",), ("mean",)),
        ("pile_height", "95 % of the top grain band", ("grain at apex and foot",), (None,)),
        ("pile_tip_radius", "parabola through the tip", (), (None,)),
    ):
        mine = [
            one for one in singles
            if (one.quantity, one.method) == (quantity, method) and one.detail.get("side") in sides
        ]  # fmt: skip
        one = pick(found, quantity, method, view="all")
        assert (one.n, len(mine), one.unit) == (3 * len(sides), one.n, mine[0].unit)
        assert one.value == pytest.approx(np.mean([each.value for each in mine]))
        assert one.budget == pytest.approx(combined(mine, parts))
        assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))
        spread = float(np.std([each.value for each in mine], ddof=1))
        side = {"side": "mean"} if one.unit == "deg" else {}
        assert one.detail == {**side, "view": "all", "standard_deviation": pytest.approx(spread)}
        assert not one.doubtful
    assert len(found.quantities) == len(singles) + 8
    assert [one.quantity for one in found.quantities[:2]] == [GRAPHICAL, GEOMETRIC]
    assert found.quantities[0].detail["view"] == "all"
    assert [check.check for check in found.checks] == ["views_agree", "views_agree"]


def test_a_doubtful_view_counts_in_no_mean_and_one_that_is_left_is_not_confirmed() -> None:
    sound, other, steep = heap(view="sound"), heap(view="other"), heap(64, 64, height=0.0301, view="steep")
    found = evaluate([sound, steep], bead_diameter=GRAIN)
    alone = evaluate([sound], bead_diameter=GRAIN)
    mean = pick(found, GEOMETRIC, "apex", view="all")
    assert mean.value == pick(alone, GEOMETRIC, "apex", "mean").value
    assert mean.n == 1
    assert mean.detail == {"side": "mean", "view": "all"}
    assert "only one view is not doubtful, and no other view confirms it; left out: steep" in mean.doubtful
    assert "left out of the mean over views because doubtful: steep." in found.warnings
    reason = "the left flank has 64 deg, steeper than a loose heap: something hides or adds to it"
    assert f"steep: {reason}" in found.warnings
    assert reason not in evaluate([steep], bead_diameter=GRAIN).warnings  # it stands at the quantities
    two = evaluate([sound, other, steep], bead_diameter=GRAIN)
    assert pick(two, GRAPHICAL, LINE, view="all").n == 4
    assert "only one view" not in pick(two, GRAPHICAL, LINE, view="all").doubtful
    bad = evaluate([steep, replace(steep, view="again")], bead_diameter=GRAIN)
    assert pick(bad, GRAPHICAL, LINE, view="all").doubtful == reason
    assert pick(bad, GRAPHICAL, LINE, view="all").n == 4
    assert not any("left out" in warning for warning in bad.warnings)


def test_warnings_of_photos_name_their_view_and_unconfirmed_sizes_stand_once() -> None:
    two = [Observation(one, unconfirmed="nothing shows the scale.", notes=("note.",)) for one in three_views()[:2]]
    found = evaluate_views(two, None, GRAIN)
    assert found.warnings.count("nothing shows the scale.") == 1
    assert found.warnings.count("note.") == 2
    steep = [heap(30, 42, view=name) for name in ("one", "two")]
    uneven = [warning for warning in evaluate(steep, bead_diameter=GRAIN).warnings if "left minus right" in warning]
    assert [f"({name})" in warning for name, warning in zip(("one", "two"), uneven, strict=True)] == [True, True]
    narrow = evaluate([heap()], base_diameter=WIDE, bead_diameter=WIDE / 20)
    assert any("20.0 bead diameters wide" in warning for warning in narrow.warnings)
    assert not evaluate([heap()], base_diameter=WIDE, bead_diameter=GRAIN).warnings


def test_a_profile_without_a_heap_is_refused_with_the_points_that_it_has() -> None:
    x = np.linspace(-0.05, 0.05, 100)
    level = np.full(100, -0.001)
    level[:10] = np.nan
    with pytest.raises(NothingToMeasure) as refusal:
        evaluate([heap(), Profile(x, level, np.zeros(100), view="side")])
    assert str(refusal.value) == (
        "profile 2 (side) has 90 points of known height, of which 0 lie above its base line, and shows no heap there; "
        "check that heights are measured upwards from the base, or state the base of a photo with --base x1,y1,x2,y2."
    )
    few = Profile(np.where(np.arange(9) == 4, np.nan, x[:9]), np.linspace(-0.01, 0.01, 9), np.zeros(9))
    few = replace(few, height=np.where(np.arange(9) == 0, np.nan, few.height))
    with pytest.raises(
        NothingToMeasure, match=r"^profile 1 \(front\) has 7 points of known height, of which 4 lie above"
    ):
        evaluate([few])
