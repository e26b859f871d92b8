"""Rigs of the user's own: beds against plane walls, motions against closed forms, counting against conservation."""

import math
from dataclasses import replace
from pathlib import Path

import gsd.hoomd
import numpy as np
import pandas as pd
import pytest
import trimesh

from rigtwin.cli import run
from rigtwin.lab import stl
from rigtwin.lab.checksums import sha256
from rigtwin.lab.custom_rig import CustomRig, Region, StlWall
from rigtwin.lab.errors import BadInput, SimulationFailed
from rigtwin.lab.materials import Contact
from rigtwin.lab.reference import hlosta2020
from rigtwin.sim import custom
from rigtwin.sim.engine.walls.shapes import Plane
from rigtwin.sim.output.replay import Frame
from rigtwin.sim.run import filling
from rigtwin.sim.run.set_up import Bench

D6 = hlosta2020.particle("D6")
PMMA = hlosta2020.material("PMMA")
AMONG, AT_WALL = hlosta2020.contact("D6", "D6"), hlosta2020.contact("D6", "PMMA")
SMOOTH = Contact(0.1, 0.0, 0.0)
G = 9.81


def wall(folder: Path, name: str, mesh: trimesh.Trimesh, **motion) -> StlWall:
    """A wall of a mesh in millimetres."""
    path = folder / f"{name}.stl"
    mesh.export(path)
    return StlWall(str(path), 1e-3, sha256(path), "PMMA", **motion)


def cup(wide: float, high: float) -> trimesh.Trimesh:
    """A square cup without a lid, its floor at z = 0."""
    mesh = trimesh.creation.box((wide, wide, high))
    mesh.apply_translation((0, 0, high / 2))
    mesh.update_faces(~np.isclose(mesh.triangles_center[:, 2], high))
    return mesh


def quad(*corners: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]])


def floor(half: float, z: float = 0.0) -> trimesh.Trimesh:
    return quad((-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z))


def single(x: float, z: float) -> Region:
    """Room for one bead in the lattice."""
    side = 1.4 * D6.diameter / 2
    return Region((x - side, -side, z), (x + side, side, z + 2 * side))


def heights(folder: Path, seed: int) -> tuple[float, float]:
    """Height [m] of a bed in a cup from an STL file, and of the same beads between five planes."""
    box = Region((-0.02, -0.02, 0.0), (0.02, 0.02, 0.1))
    rig = CustomRig({"cup": wall(folder, "cup", cup(40, 120))}, box, end="at rest", regions={"bed": box})
    course = custom.run(rig, D6, PMMA, AMONG, AT_WALL, count=200, seed=seed)
    assert course.at_rest
    assert course.inside["bed"][0] == 200
    planes = [Plane((0, 0, 0), (0, 0, 1))]
    planes += [Plane(tuple(-0.02 * s * np.eye(3)[k]), tuple(s * np.eye(3)[k])) for k in (0, 1) for s in (-1.0, 1.0)]
    bulk = Bench(rig, D6, PMMA, AMONG, AT_WALL, {}).bulk(planes, ((-0.03, -0.03, -0.01), (0.03, 0.03, 0.13)))
    source = custom.FillRegion(rig)
    places, _, _ = filling.scattered(200, source.inside, source.box, D6, np.random.default_rng(seed), thrown=0.0)
    bulk.add(places)
    bulk.run(round(0.5 / bulk.time_step))
    beads = bulk.beads()
    return course.bed_heights["bed"], custom.bed_height(box, beads.position, beads.radius)


def test_a_bed_in_an_stl_box_is_that_between_planes(tmp_path):
    found = np.array([heights(tmp_path, seed) for seed in (1, 2, 3)])
    # seeds scatter by 0.5 mm; beds of the same start by a tenth of that
    assert found[:, 0].mean() == pytest.approx(found[:, 1].mean(), abs=0.25e-3)


def on_belt(folder: Path, friction: Contact, **motion) -> float:
    """Speed [m/s] of a bead 0.7 s after it has been placed on a moving plate."""
    plate = wall(folder, "plate", floor(300.0), velocity=(0.2, 0.0, 0.0), **motion)
    rig = CustomRig({"plate": plate}, single(-0.1, 0.001), duration=0.7, interval=0.01)
    folder.joinpath("belt.gsd").unlink(missing_ok=True)
    custom.run(rig, D6, PMMA, AMONG, friction, count=1, trajectory=folder / "belt.gsd")
    with gsd.hoomd.open(folder / "belt.gsd") as file:
        return float(file[-1].particles.velocity[0, 0])


def test_a_ball_on_a_belt_rolls_at_two_sevenths_of_its_speed_and_one_that_cannot_roll_takes_all_of_it(tmp_path):
    # from rest: m v = J and (2/5) m R^2 w = J R, and rolling means v + w R = v_belt
    rolls = Contact(0.2, 0.8, 0.0)
    assert on_belt(tmp_path, rolls, belt=True) == pytest.approx(0.2 * 2 / 7, rel=0.01)
    assert on_belt(tmp_path, replace(rolls, rolling_friction=5.0), belt=True) == pytest.approx(0.2, rel=0.01)
    # a plate that moves as a whole does the same as long as the ball is on it
    assert on_belt(tmp_path, rolls) == pytest.approx(0.2 * 2 / 7, rel=0.01)


def test_a_turning_paddle_throws_a_smooth_bead_outwards_as_a_turning_tube_does(tmp_path):
    spin, start = 2 * math.pi, 0.25
    paddle = quad((5, 0, 0.5), (120, 0, 0.5), (120, 0, 20), (5, 0, 20))
    walls = {
        "floor": wall(tmp_path, "floor", floor(150.0)),
        "paddle": wall(tmp_path, "paddle", paddle, rotation_speed=spin, start=start),
    }
    fill = Region((0.02, 0.004, 0.0005), (0.0285, 0.0125, 0.009))
    rig = CustomRig(walls, fill, duration=0.5, low=(-0.2, -0.2, -0.05), high=(0.2, 0.2, 0.1))
    # the time step follows from the restitution: without a bounce the bead stays on the paddle
    course = custom.run(
        rig, D6, PMMA, SMOOTH, SMOOTH, count=1, trajectory=tmp_path / "p.gsd", trajectory_interval=1e-3,
        stiffness_factor=0.01,
    )  # fmt: skip
    with gsd.hoomd.open(tmp_path / "p.gsd") as file:
        rows = [(frame.log["time_s"][0], *frame.particles.position[0], *frame.particles.velocity[0]) for frame in file]
    time, x, y, z, u, v, _ = np.array(rows).T
    turned = spin * np.maximum(time - start, 0.0)
    along, off = x * np.cos(turned) + y * np.sin(turned), y * np.cos(turned) - x * np.sin(turned)
    assert off.min() > D6.radius * 0.97  # never inside the paddle
    met = int(np.argmax(off < 1.01 * D6.radius))
    assert 0 < met < len(time) - 100
    # along the paddle s'' = w^2 s, from a bead at rest before: s' = w R as it is met
    since = spin * (time[met:] - time[met])
    assert along[met:] == pytest.approx(along[met] * np.cosh(since) + D6.radius * np.sinh(since), rel=0.03)
    assert z[met:] == pytest.approx(D6.radius, rel=0.03)
    assert along[-1] > 1.5 * along[met]
    # the angular impulse of the paddle is the angular momentum of the bead
    _, load = course.loads
    impulse = np.sum(load.about_axis * np.diff(load.time, prepend=0.0))
    assert impulse == pytest.approx(-D6.mass * (x * v - y * u)[-1], rel=1e-3)


def test_a_cup_that_is_turned_over_empties_and_every_bead_is_counted_once(tmp_path):
    turned = wall(
        tmp_path, "cup", cup(40, 60), rotation_speed=4 * math.pi, rotation_axis=(0.0, 1.0, 0.0),
        rotation_point=(0.0, 0.0, 0.03), start=0.3, stop=0.55,
    )  # fmt: skip
    rig = CustomRig(
        {"cup": turned}, Region((-0.02, -0.02, 0.0), (0.02, 0.02, 0.06)), low=(-0.3, -0.3, -0.1),
        high=(0.3, 0.3, 0.2), duration=2.0, end="empty",
    )  # fmt: skip
    course = custom.run(rig, D6, PMMA, AMONG, AT_WALL, count=80, seed=2)
    times = course.series[0].time
    inside, mass = course.series[0].value, course.series[1].value
    assert inside[times < 0.3].tolist() == [80] * int((times < 0.3).sum())
    assert inside[-1] == 0
    assert course.time < 1.5
    assert course.discharged[0] + course.escaped[0] == 80
    assert course.discharged[1] + course.escaped[1] == pytest.approx(80 * D6.mass)
    discharged = next(one for one in course.series if one.quantity == "mass_discharged").value
    escaped = 80 * D6.mass - mass - discharged
    assert (np.diff(escaped) > -1e-12).all()


def test_a_bed_at_rest_weighs_on_its_walls_what_its_beads_weigh(tmp_path):
    away = cup(40, 120)
    away.apply_translation((200, 100, 0))  # [mm]
    sides = away.copy()
    sides.update_faces(away.triangles_center[:, 2] > 1e-9)
    base = away.copy()
    base.update_faces(away.triangles_center[:, 2] <= 1e-9)
    walls = {"sides": wall(tmp_path, "sides", sides), "base": wall(tmp_path, "base", base)}
    box = Region((0.18, 0.08, 0.0), (0.22, 0.12, 0.1))
    rig = CustomRig(walls, box, end="at rest", regions={"bed": box}, interval=0.1)
    course = custom.run(rig, D6, PMMA, AMONG, AT_WALL, count=200)
    assert course.at_rest
    weight = G * course.inside["bed"][1]
    sides_load, base_load = course.loads
    assert (sides_load.wall, base_load.wall) == ("sides", "base")
    assert base_load.force[-1, 2] < -0.5 * weight  # the sides carry the rest by friction
    force = sides_load.force[-1] + base_load.force[-1]
    assert force == pytest.approx((0, 0, -weight), abs=0.01 * weight)
    torque = sides_load.torque[-1] + base_load.torque[-1]
    x, y, _ = course.centres.mean(axis=0)
    assert torque == pytest.approx((-y * weight, x * weight, 0), abs=0.01 * 0.2 * weight)
    assert base_load.about_axis is None


def test_the_command_writes_a_table_of_the_load_of_each_wall(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cup(40, 60).export("cup.stl")
    box = "-18mm,-18mm,1mm..18mm,18mm,50mm"
    assert run(["simulate", "custom", "--stl", "cup.stl", f"--fill={box}", "--count", "40", "--out", "made"]) == 0
    assert "custom-twin-load_on_cup.csv" in capfd.readouterr().out
    table = pd.read_csv("made/custom-twin-load_on_cup.csv")
    assert list(table) == ["time_s", "fx_N", "fy_N", "fz_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm"]
    assert table.fz_N[table.time_s > table.time_s.max() - 0.1].mean() == pytest.approx(-40 * D6.mass * G, rel=0.03)


def test_the_flow_out_of_a_funnel_begins_as_its_slide_is_taken_away(tmp_path):
    narrow, wide = 16.0, 30.0
    sides = []
    for k in range(4):
        turn = trimesh.transformations.rotation_matrix(k * math.pi / 2, (0, 0, 1))
        for low, high, z, to in ((narrow, wide, 0.0, 30.0), (wide, wide, 30.0, 90.0)):
            side = quad((low, -low, z), (low, low, z), (high, high, to), (high, -high, to))
            side.apply_transform(turn)
            sides.append(side)
    walls = {
        "funnel": wall(tmp_path, "funnel", trimesh.util.concatenate(sides)),
        "slide": wall(tmp_path, "slide", floor(narrow + 0.5, -0.001), removed=0.4),
    }
    rig = CustomRig(
        walls, Region((-0.03, -0.03, 0.03), (0.03, 0.03, 0.09)), low=(-0.035, -0.035, -0.03), high=(0.035, 0.035, 0.1),
        duration=3.0, end="empty", interval=5e-3,
    )  # fmt: skip
    course = custom.run(rig, D6, PMMA, AMONG, AT_WALL, count=200, seed=1)
    assert course.discharged == (200, pytest.approx(200 * D6.mass))
    mass = next(one for one in course.series if one.quantity == "mass_discharged")
    fall = math.sqrt(2 * 0.027 / G)  # from the slide to the lower side of the domain
    assert mass.time[np.argmax(mass.value > 0)] == pytest.approx(0.4 + fall, abs=0.03)
    assert course.mass_flow_rate is not None
    assert course.mass_flow_rate == pytest.approx(course.discharged[1] / (course.time - 0.4 - fall), rel=0.35)


def test_a_run_that_was_stopped_goes_on_to_the_same_bits(tmp_path):
    shaken = wall(
        tmp_path, "cup", cup(40, 80), vibration_amplitude=(0.0, 0.0, 1e-3), vibration_frequency=20.0, start=0.1
    )
    rig = CustomRig(
        {"cup": shaken}, Region((-0.018, -0.018, 0.01), (0.018, 0.018, 0.07)), pour_rate=300.0, duration=0.4
    )

    def stop(_stage: str, done: float, _total: float) -> None:
        if done > 0.2:
            raise KeyboardInterrupt

    run = {"count": 60, "seed": 3, "checkpoint": tmp_path / "kept.npz", "checkpoint_interval": 0.0}
    with pytest.raises(KeyboardInterrupt):
        custom.run(rig, D6, PMMA, AMONG, AT_WALL, progress=stop, **run)
    resumed = custom.run(rig, D6, PMMA, AMONG, AT_WALL, **run)
    whole = custom.run(rig, D6, PMMA, AMONG, AT_WALL, count=60, seed=3)
    assert np.array_equal(resumed.centres, whole.centres)
    assert all(np.array_equal(a.value, b.value) for a, b in zip(resumed.series, whole.series, strict=True))
    (load,), (same,) = whole.loads, resumed.loads
    assert np.array_equal(load.force, same.force)
    assert np.array_equal(load.torque, same.torque)
    assert whole.inside["domain"][0] == 60


def test_the_height_of_a_bed_is_that_of_its_uppermost_beads_above_the_floor_of_the_region():
    r, box = 0.015, Region((0.0, 0.0, 0.02), (0.04, 0.04, 0.05))
    ball = np.array([[0.02, 0.02, 0.03]])
    # its upper half has the volume 2/3 pi r^3 above a disc 10 mm over the floor of the region
    filled = math.pi * r**2 * 0.01 + 2 / 3 * math.pi * r**3
    assert custom.bed_height(box, ball, np.array([r])) == pytest.approx(filled / 0.04**2, rel=0.01)
    tube = replace(box, shape="cylinder")
    assert custom.bed_height(tube, ball, np.array([r])) == pytest.approx(filled / (math.pi * 0.02**2), rel=0.01)
    corner = np.array([[0.001, 0.001, 0.03]])
    assert custom.within(box, corner)[0]
    assert not custom.within(tube, corner)[0]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"regions": {"below": Region((-0.02, -0.02, -0.2), (0.02, 0.02, -0.1))}},
            r"regions\.below: lies outside the domain.*give a larger domain",
        ),
        ({"low": (0.5, 0.5, 0.5), "high": (0.6, 0.6, 0.6)}, r"walls\.cup: lies outside the domain.*check stl_unit"),
        ({"low": (-0.03, -0.03, -0.01), "high": (0.03, 0.03, 0.04)}, "fill: is x -18 to 18 mm"),
        ({"interval": -1.0}, "interval"),
        ({"fill": Region((0.0, 0.0, 0.01), (0.004, 0.1, 0.04))}, "too narrow for a particle of 6.2 mm"),
        (
            {"fill": Region((0.0165, -0.01, 0.01), (0.0235, 0.01, 0.04))},
            "no particle finds room in it clear of the walls",
        ),
    ],
)
def test_a_rig_that_cannot_be_is_refused(tmp_path, changed, words):
    rig = CustomRig({"cup": wall(tmp_path, "cup", cup(40, 80))}, Region((-0.018, -0.018, 0.01), (0.018, 0.018, 0.07)))
    with pytest.raises(BadInput, match=words):
        custom.run(replace(rig, **changed), D6, PMMA, AMONG, AT_WALL, count=5)


def test_room_inside_of_a_closed_surface_is_a_warning_if_there_is_room_outside_too(tmp_path):
    block = trimesh.creation.box((24, 24, 24))
    block.apply_translation((0, 0, 40))
    walls = {"cup": wall(tmp_path, "cup", cup(60, 120)), "block": wall(tmp_path, "block", block)}
    rig = CustomRig(walls, Region((-0.025, -0.025, 0.004), (0.025, 0.025, 0.09)))
    [said] = custom.enclosed(rig, D6)
    # of the room for centres 3 mm clear of all surfaces
    inside, around, beside = 0.018**3, 0.044**2 * 0.08, 0.03**2 * 0.03
    share = 100 * inside / (around - beside + inside)
    assert float(said.split(" % ")[0].split()[-1]) == pytest.approx(share, abs=3)
    assert said.startswith("walls.block: is a closed surface")
    vessel = CustomRig({"block": walls["block"]}, Region((-0.011, -0.011, 0.03), (0.011, 0.011, 0.05)))
    assert custom.enclosed(vessel, D6) == []
    corners = np.array(block.triangles) / 1e3
    within = stl.encloses(corners, np.array([[0.001, 0.002, 0.03], [0.013, 0.002, 0.04]]))
    assert within.tolist() == [True, False]


def test_room_that_lies_wholly_inside_of_a_block_beside_other_walls_is_a_warning(tmp_path):
    block = trimesh.creation.box((24, 24, 24))
    block.apply_translation((0, 0, 40))
    lifter = trimesh.creation.box((2, 2, 2))
    lifter.apply_translation((10, 0, 40))
    inside = Region((-0.008, -0.008, 0.032), (0.008, 0.008, 0.048))
    about = {"block": wall(tmp_path, "block", block)}
    (said,) = custom.enclosed(CustomRig({**about, "cup": wall(tmp_path, "cup", cup(60, 120))}, inside), D6)
    assert said.startswith("walls.block: is a closed surface, and all of the room in fill lies inside of it")
    assert custom.enclosed(CustomRig({**about, "lifter": wall(tmp_path, "lifter", lifter)}, inside), D6) == []


def test_a_motion_that_would_begin_after_the_run_is_a_warning(tmp_path):
    slow = wall(tmp_path, "slide", floor(20.0, -1.0), velocity=(0.1, 0.0, 0.0), start=3.0)
    gone = wall(tmp_path, "lid", floor(20.0, 79.0), removed=0.02)
    said = run_of(box_rig(tmp_path, {"slide": slow, "lid": gone}, duration=0.05)).warnings
    assert [each for each in said if each.startswith("walls.")] == [
        "walls.slide: begins to move at 3 s (start), and the run ends at 0.05 s (duration) at the latest; "
        "correct one of them"
    ]


def test_a_bead_thrown_too_fast_by_a_paddle_is_blamed_on_the_paddle(tmp_path):
    paddle = trimesh.creation.box((30, 2, 30))
    paddle.apply_translation((0, 0, 16))
    turning = wall(tmp_path, "paddle", paddle, rotation_speed=2 * math.pi * 100 * 4)
    with pytest.raises((BadInput, SimulationFailed), match=r"walls\.paddle moves .* let it move more slowly"):
        run_of(box_rig(tmp_path, {"paddle": turning}, duration=0.2), count=20)


def test_a_wall_too_fast_for_the_time_step_is_named(tmp_path):
    fast = wall(tmp_path, "cup", cup(40, 80), velocity=(0.0, 0.0, 50.0))
    rig = CustomRig(
        {"cup": fast}, Region((-0.018, -0.018, 0.01), (0.018, 0.018, 0.07)), low=(-0.1, -0.1, -0.1), high=(0.1,) * 3
    )
    with pytest.raises(BadInput, match=r"walls\.cup moves by up to .* let it move more slowly"):
        custom.run(rig, D6, PMMA, AMONG, AT_WALL, count=5)


def box_rig(folder: Path, walls: dict[str, StlWall] | None = None, **changed) -> CustomRig:
    """A cup of 40 mm with room for a few beads near its floor, and other walls."""
    fill = Region((-0.018, -0.018, 0.0005), (0.018, 0.018, 0.018))
    return replace(CustomRig({"cup": wall(folder, "cup", cup(40, 80)), **(walls or {})}, fill), **changed)


def run_of(rig: CustomRig, count: int = 10, **settings) -> custom.CustomRun:
    return custom.run(rig, D6, PMMA, AMONG, AT_WALL, count=count, **settings)


def test_a_run_does_not_end_at_rest_while_a_wall_moves_or_is_still_to_be_removed(tmp_path):
    piston = wall(tmp_path, "piston", floor(10.0, 70.0), velocity=(0.0, 0.0, -2e-4), stop=0.5)
    assert run_of(box_rig(tmp_path, {"piston": piston}, end="at rest")).time == pytest.approx(0.56, abs=0.03)
    late = replace(piston, velocity=(0.0, 0.0, 0.0), stop=None, removed=0.5)
    assert run_of(box_rig(tmp_path, {"piston": late}, end="at rest")).time == pytest.approx(0.56, abs=0.03)
    # every look falls on a moment at which the cup stands at its middle or a turning point
    shaken = wall(tmp_path, "cup", cup(40, 80), vibration_amplitude=(0.0, 0.0, 1e-4), vibration_frequency=50.0)
    course = run_of(replace(box_rig(tmp_path, end="at rest", duration=0.4), walls={"cup": shaken}))
    assert course.time == pytest.approx(0.4, abs=1e-4)
    assert not course.at_rest
    assert any("a wall still moved" in one for one in course.warnings)


def test_a_wall_that_was_removed_while_it_turned_keeps_no_run_going(tmp_path):
    blade = wall(tmp_path, "blade", floor(5.0, 70.0), rotation_speed=1.0, removed=0.3)
    course = run_of(box_rig(tmp_path, {"blade": blade}, end="empty", duration=2.0))
    assert course.time == pytest.approx(0.36, abs=0.05)
    assert any("particles rest" in one for one in course.warnings)


@pytest.mark.parametrize("pour", [{}, {"pour_rate": 500.0}], ids=["at once", "poured"])
def test_filling_waits_for_a_slide_that_makes_room_and_stops_with_a_warning_where_none_comes(
    tmp_path, pour, monkeypatch
):
    monkeypatch.setattr(filling, "PATIENCE", 10)
    shelf = wall(tmp_path, "shelf", floor(19.5, 30.0), removed=0.6)
    fill = Region((-0.018, -0.018, 0.031), (0.018, 0.018, 0.045))
    rig = box_rig(tmp_path, {"shelf": shelf}, fill=fill, duration=1.6, end="at rest", **pour)
    course = run_of(rig, 90)
    assert course.placed == 90
    full = run_of(replace(rig, walls={**rig.walls, "shelf": replace(shelf, removed=None)}), 120)
    assert 20 < full.placed < 90
    assert full.time < 1.5
    assert any(f"only {full.placed} of 120 particles found room in the fill region" in one for one in full.warnings)


def test_a_pour_that_was_cut_short_is_not_blamed_on_the_fill_region(tmp_path):
    rig = box_rig(tmp_path, pour_rate=100.0, duration=0.2, fill=Region((-0.018, -0.018, 0.04), (0.018, 0.018, 0.07)))
    course = run_of(rig, 200)
    assert f"only {course.placed} of 200 particles were placed in 0.2 s; raise duration or pour_rate" in course.warnings


def test_the_interval_of_the_tables_changes_nothing_else(tmp_path):
    rig = box_rig(tmp_path, duration=0.31)
    courses = {interval: run_of(replace(rig, interval=interval), 60) for interval in (0.01, 0.02, 0.1, 0.5)}
    for interval, course in courses.items():
        assert course.placed == courses[0.01].placed
        assert np.array_equal(course.centres, courses[0.01].centres)
        assert course.time == pytest.approx(0.31, abs=1e-4)
        looks = [k * interval for k in range(math.ceil(0.31 / interval - 1e-9))]
        assert course.series[0].time == pytest.approx([*looks, 0.31], abs=1e-4)


def test_a_bead_that_comes_back_through_the_border_is_counted_once(tmp_path):
    post = quad((18, 18, 0), (20, 18, 0), (20, 18, 20), (18, 18, 20))  # reaches into the domain
    mesh = trimesh.util.concatenate([floor(20.0), post])
    plate = wall(tmp_path, "plate", mesh, vibration_amplitude=(0.0, 0.0, 2e-3), vibration_frequency=5.0, start=0.1)
    # the border is where the bead lies on the plate
    low, high = (-0.05, -0.05, D6.diameter / 2 - 1e-4), (0.05, 0.05, 0.05)
    rig = CustomRig({"plate": plate}, single(0.0, D6.diameter / 2), low=low, high=high, duration=0.6, interval=2e-3)
    frames = [
        Frame(0.1 * k, np.array([0]), np.array([[0.0, 0.0, z]]), np.zeros((1, 3)))
        for k, z in enumerate((0.01, 0.0, 0.01, 0.0, 0.01))
    ]
    for course in (run_of(rig, 1), custom.replayed(rig, D6, frames, asked=1, placed=1)):
        assert course.discharged[0] + course.escaped[0] == 1
        assert course.series[0].value[-1] == 0


def test_the_domain_holds_a_blade_however_fast_it_turns(tmp_path):
    blade = quad((-100, -1, 0), (100, -1, 0), (100, 1, 0), (-100, 1, 0))
    fast = wall(tmp_path, "blade", blade, rotation_speed=2985 * math.pi / 30, velocity=(0.0, 0.0, 0.01))
    low, high = custom.domain_of(CustomRig({"blade": fast}, single(0.0, 0.01)), D6)
    margin = custom.MARGIN * D6.diameter
    assert low[:2] == pytest.approx([-0.1 - margin] * 2, rel=1e-3)
    assert high == pytest.approx([0.1 + margin, 0.1 + margin, 0.02 + margin], rel=0.02)


def test_a_wall_that_enters_a_stated_domain_later_is_not_refused(tmp_path):
    pusher = wall(tmp_path, "pusher", floor(10.0, 150.0), velocity=(0.0, 0.0, -1.0), stop=0.1)
    rig = box_rig(tmp_path, {"pusher": pusher}, low=(-0.03, -0.03, -0.01), high=(0.03, 0.03, 0.1))
    custom.check(rig, D6, count=1)
    still = {**rig.walls, "pusher": replace(pusher, velocity=(0.0, 0.0, 0.0), stop=None)}
    with pytest.raises(BadInput, match=r"walls\.pusher: lies outside the domain"):
        custom.check(replace(rig, walls=still), D6, count=1)
