"""Trajectories are read back frame by frame; the mesh has the area of the walls; the energy balance closes."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gsd.hoomd
import h5py
import numpy as np
import pytest

from rigtwin.lab.errors import BadInput, SimulationFailed
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.output_files import claimed_file
from rigtwin.lab.rigs import Pile
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.bulk.particle_state import Beads
from rigtwin.sim.engine.walls.shapes import Cylinder, Disc, Plane, Wall
from rigtwin.sim.output import trajectory
from rigtwin.sim.pile import pile
from rigtwin.sim.run.run_log import Logbook

G = 9.81
ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
D6 = Particle("D6", ASH, 6e-3, density=569)
SOFT = replace(D6, material=ASH.softened(1e-3))
BOWL = Pile(0.04, rim_height=0.008, outlet_diameter=0.02)
BEADS, BASE = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)
DOMAIN = (np.array([-0.1, -0.2, -0.01]), np.array([0.1, 0.1, 0.3]))
SUFFIXES = [".gsd", ".vtkhdf"]
COUNTS = (0, 5, 300, 280, 310, 1)  # numbers of beads in the frames


def some_beads(count: int, seed: int) -> Beads:
    rng = np.random.default_rng(seed)
    ident = np.sort(rng.choice(1000, count, replace=False))
    return Beads(
        ident, ident % 2, rng.uniform(-0.05, 0.05, (count, 3)), rng.normal(0, 1, (count, 3)),
        rng.normal(0, 50, (count, 3)), rng.uniform(1e-3, 3e-3, count), rng.uniform(1e-4, 2e-4, count),
    )  # fmt: skip


def film(path, counts=COUNTS, first=0):
    made = trajectory.begin(path, ["D6", "D12"], DOMAIN, frames=first)
    for k in range(first, len(counts)):
        made.add(some_beads(counts[k], k), 0.01 * k, 250 * k)
    made.close()
    return path


def frames_of(path) -> list[dict[str, np.ndarray]]:
    """Frames as plain arrays, whatever the format."""
    return frames_of_gsd(path) if path.suffix == ".gsd" else frames_of_vtkhdf(path)


def frames_of_gsd(path):
    with gsd.hoomd.open(path, mode="r") as read:
        return [
            {
                "time": frame.log["time_s"][0],
                "position": frame.particles.position,
                "velocity": frame.particles.velocity,
                "radius": frame.particles.diameter / 2,
                "kind": frame.particles.typeid,
                "spin": frame.log["particles/spin"],
                "ident": frame.log["particles/ident"],
            }
            for frame in read
        ]


def frames_of_vtkhdf(path):
    """Read by the published layout: every step has the offsets of its points, cells and data."""
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        steps = root["Steps"]
        frames = []
        for k in range(int(steps.attrs["NSteps"])):
            part = int(steps["PartOffsets"][k])
            count, begin = int(root["NumberOfPoints"][part]), int(steps["PointOffsets"][k])
            frame = {"time": steps["Values"][k], "position": root["Points"][begin : begin + count]}
            for name, dataset in root["PointData"].items():
                begin = int(steps["PointDataOffsets"][name][k])
                frame[name] = dataset[begin : begin + count]
            frames.append(frame)
        return frames


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_frame_comes_back_with_all_that_was_put_in(suffix, tmp_path):
    frames = frames_of(film(tmp_path / f"film{suffix}"))
    assert len(frames) == len(COUNTS)
    for k, frame in enumerate(frames):
        put_in = some_beads(COUNTS[k], k)
        assert frame["time"] == 0.01 * k
        for name in ("ident", "kind"):
            assert np.array_equal(frame[name], getattr(put_in, name)), name
        for name in ("position", "velocity", "spin", "radius"):
            assert frame[name] == pytest.approx(getattr(put_in, name), rel=1e-6, abs=0), name


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("first", [1, 3, len(COUNTS)])
def test_a_continued_trajectory_is_like_an_uninterrupted_one(suffix, first, tmp_path):
    whole = frames_of(film(tmp_path / f"whole{suffix}"))
    path = film(
        tmp_path / f"film{suffix}", counts=(*COUNTS[:first], 40, 400, 7)
    )  # the frames after `first` are dropped
    path = film(path, first=first)
    again = frames_of(path)
    assert len(again) == len(whole)
    for one, other in zip(again, whole, strict=True):
        assert all(np.array_equal(one[name], other[name]) for name in other)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_trajectory_gets_its_name_and_replaces_an_old_one_when_it_is_closed(suffix, tmp_path):
    path = film(tmp_path / f"film{suffix}")
    before = path.read_bytes()
    made = trajectory.begin(path, ["D6"], DOMAIN)
    made.add(some_beads(3, 1), 0.0, 0)
    assert path.read_bytes() == before
    made.close()
    assert len(frames_of(path)) == 1
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_frames_can_be_read_during_the_run(tmp_path):
    made = trajectory.begin(tmp_path / "film.gsd", ["D6"], DOMAIN)
    made.add(some_beads(30, 1), 0.0, 0)
    made.add(some_beads(31, 2), 0.1, 1)
    assert [len(frame["ident"]) for frame in frames_of_gsd(tmp_path / "film.gsd.part")] == [30, 31]
    made.close()


def test_the_box_of_a_gsd_file_holds_the_whole_domain(tmp_path):
    with gsd.hoomd.open(film(tmp_path / "film.gsd"), mode="r") as read:
        frame = read[2]
    assert frame.configuration.step == 500
    assert frame.configuration.box.tolist() == pytest.approx([0.2, 0.4, 0.6, 0, 0, 0])
    assert frame.particles.types == ["D6", "D12"]
    assert frame.particles.mass == pytest.approx(some_beads(300, 2).mass)


def test_a_vtkhdf_file_has_the_published_layout(tmp_path):
    """VTK's file format page, "VTKHDF: PolyData" and "Temporal data": types, attributes and sizes of the tables."""
    with h5py.File(film(tmp_path / "film.vtkhdf")) as file:
        root = file["VTKHDF"]
        assert root.attrs["Version"].tolist()[0] == 2
        kind = h5py.h5a.open(root.id, b"Type").get_type()
        assert root.attrs["Type"] == b"PolyData"
        assert (kind.is_variable_str(), kind.get_cset()) == (False, h5py.h5t.CSET_ASCII)
        steps, frames = root["Steps"], len(COUNTS)
        assert steps.attrs["NSteps"] == frames
        assert steps["NumberOfParts"][:].tolist() == [1] * frames
        assert root["NumberOfPoints"][:].tolist() == list(COUNTS)
        for table in ("PartOffsets", "PointOffsets", "Values"):
            assert steps[table].shape == (frames,)
        for table in ("CellOffsets", "ConnectivityIdOffsets"):
            assert steps[table].shape == (frames, 4)
        assert set(steps["PointDataOffsets"]) == set(root["PointData"])
        for k, count in enumerate(COUNTS):  # every bead is one vertex cell of the frame's own points
            cells, begin = root["Vertices"], int(steps["CellOffsets"][k, 0])
            assert (cells["NumberOfCells"][k], cells["NumberOfConnectivityIds"][k]) == (count, count)
            offsets = cells["Offsets"][begin : begin + count + 1]
            begin = int(steps["ConnectivityIdOffsets"][k, 0])
            points = cells["Connectivity"][begin : begin + count]
            assert np.diff(offsets).tolist() == [1] * count
            assert sorted(points) == list(range(count))
        for empty in ("Lines", "Polygons", "Strips"):
            assert root[empty]["NumberOfCells"][:].tolist() == [0] * frames
            assert root[empty]["Offsets"].shape == (1,)


def test_a_format_that_is_not_known_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"film\.xyz has no known suffix; use \.gsd .* \.vtkhdf"):
        trajectory.begin(tmp_path / "film.xyz", ["D6"], DOMAIN)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_incomplete_or_damaged_trajectory_is_not_continued(suffix, tmp_path):
    path = film(tmp_path / f"film{suffix}")
    with pytest.raises(BadInput, match="holds 6 of the 9 frames"):
        trajectory.begin(path, ["D6"], DOMAIN, frames=9)
    other = tmp_path / f"other{suffix}"
    other.write_bytes(b"something else")
    with pytest.raises(BadInput, match=f"other{suffix} cannot be"):
        trajectory.begin(other, ["D6"], DOMAIN, frames=2)
    assert other.read_bytes() == b"something else"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_moving_a_damaged_trajectory_away_helps_and_a_damaged_part_file_is_named(suffix, tmp_path):
    path = film(tmp_path / f"film{suffix}")
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(BadInput, match=f"film{suffix} cannot be"):
        trajectory.begin(path, ["D6"], DOMAIN, frames=4)
    assert list(tmp_path.iterdir()) == [path]
    path.rename(tmp_path / "away")
    trajectory.begin(path, ["D6"], DOMAIN, frames=4).close()
    part = path.with_name(path.name + ".part")
    part.write_bytes(b"something else")
    with pytest.raises(BadInput, match=f"film{suffix}.part cannot be"):
        trajectory.begin(path, ["D6"], DOMAIN, frames=4)


# ---------------------------------------------------------------------- walls


def area(mesh) -> float:
    return float(np.linalg.norm(np.cross(mesh[:, 1] - mesh[:, 0], mesh[:, 2] - mesh[:, 0]), axis=1).sum() / 2)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (Disc((0.01, 0, 0.02), (0.2, 0.5, 1), 0.03), math.pi * 0.03**2),
        (Cylinder((0.01, 0, 0.02), (0, 0, 2), 0.03, 0.05), 2 * math.pi * 0.03 * 0.05),
        (Plane((0, 0, 0), (0, 0, 1)), 0.2 * 0.3),
        (Plane((0, 0, 0.145), (1, 0, 1)), 0.3 * 0.2 * math.sqrt(2)),  # a slope from wall to wall of the box
        (Plane((0, 0, 5), (0, 0, 1)), 0.0),  # outside
    ],
)
def test_a_wall_has_its_own_area_as_a_mesh(shape, expected):
    # 72 corners around take 0.13 % off a disc
    mesh = trajectory.triangles(shape, DOMAIN)
    assert area(mesh) == pytest.approx(expected, rel=2e-3)
    if len(mesh):
        assert np.all(mesh.reshape(-1, 3) >= DOMAIN[0] - 1e-9)
        assert np.all(mesh.reshape(-1, 3) <= DOMAIN[1] + 1e-9)


def test_the_walls_form_one_mesh_with_the_number_of_each(tmp_path):
    shapes = [Disc((0, 0, 0), (0, 0, 1), 0.02), Cylinder((0, 0, 0), (0, 0, 1), 0.02, 0.01)]
    trajectory.write_walls(tmp_path / "walls.vtk", shapes, DOMAIN)
    lines = (tmp_path / "walls.vtk").read_text().splitlines()
    assert lines[0] == "# vtk DataFile Version 3.0"
    start = {line.split()[0]: (k, line.split()) for k, line in enumerate(lines) if line[:1].isalpha()}
    points, polygons = int(start["POINTS"][1][1]), int(start["POLYGONS"][1][1])
    k = start["POINTS"][0] + 1
    corners = np.array([line.split() for line in lines[k : k + points]], dtype=float)
    k = start["POLYGONS"][0] + 1
    faces = np.array([line.split() for line in lines[k : k + polygons]], dtype=int)
    assert int(start["POLYGONS"][1][2]) == faces.size
    wall = np.array(lines[start["LOOKUP_TABLE"][0] + 1 :], dtype=int)
    assert area(corners[faces[wall == 0, 1:]]) == pytest.approx(math.pi * 0.02**2, rel=2e-3)
    assert area(corners[faces[wall == 1, 1:]]) == pytest.approx(2 * math.pi * 0.02 * 0.01, rel=2e-3)


# ---------------------------------------------------------------------- a run and its energy balance


def heap(**more) -> pile.Heap:
    more = {"count": 90, "seed": 5, "threads": 1, "settle_limit": 0.3} | more
    return pile.run(BOWL, D6, STEEL, BEADS, BASE, **more)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[pile.Heap, list[dict[str, np.ndarray]]]:
    path = tmp_path_factory.mktemp("whole") / "heap.gsd"
    return heap(trajectory=path, trajectory_interval=5e-3), frames_of(path)


def test_the_trajectory_of_a_pile_ends_with_the_heap_and_has_a_frame_at_every_interval(whole):
    made, frames = whole
    times = np.array([frame["time"] for frame in frames])
    assert np.diff(times[:-1]) == pytest.approx(5e-3, rel=0.01)
    assert (times[0], times[-1]) == (0.0, made.time)
    last = frames[-1]["position"]
    on_base = (np.hypot(last[:, 0], last[:, 1]) < BOWL.base_diameter / 2 + D6.radius) & (last[:, 2] > 0)
    assert last[on_base] == pytest.approx(made.centres, abs=1e-7)
    assert max(int(frame["ident"].max(initial=-1)) for frame in frames) == 89


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_interrupted_and_resumed_run_has_the_trajectory_of_an_uninterrupted_one(suffix, whole, tmp_path):
    more = {"trajectory": tmp_path / f"heap{suffix}", "trajectory_interval": 5e-3, "checkpoint": tmp_path / "heap.npz"}
    looks = []

    def power_cut(stage, done, total):
        looks.append(stage)
        if len(looks) == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        heap(checkpoint_interval=0, progress=power_cut, **more)
    assert 20 < len(frames_of(more["trajectory"])) < len(whole[1])
    resumed = heap(**more)
    assert resumed.warnings == whole[0].warnings
    for one, other in zip(frames_of(more["trajectory"]), whole[1], strict=True):
        assert all(np.array_equal(one[name], other[name]) for name in other)
    heap(**more)  # a finished run adds nothing
    assert len(frames_of(more["trajectory"])) == len(whole[1])


def test_a_trajectory_that_begins_at_the_interruption_gives_a_warning(tmp_path):
    def power_cut(stage, done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        heap(checkpoint=tmp_path / "heap.npz", checkpoint_interval=0, progress=power_cut)
    resumed = heap(checkpoint=tmp_path / "heap.npz", trajectory=tmp_path / "heap.gsd")
    assert any("the trajectory begins at t = 0.02" in warning for warning in resumed.warnings)
    again = heap(checkpoint=tmp_path / "heap.npz", trajectory=tmp_path / "heap.gsd")
    assert again.warnings == resumed.warnings


def test_the_frames_before_a_failure_are_kept(tmp_path):
    run = lone([0.03, 0, 0.05], velocity=[1.5, 0, 0], gravity=(0, 0, 0))
    with pytest.raises(SimulationFailed):
        looked_at(run, 2000, trajectory=tmp_path / "film.gsd")
    frames = frames_of(tmp_path / "film.gsd")
    assert frames[-1]["position"][0, 0] == pytest.approx(0.03 + 1.5 * frames[-1]["time"], rel=1e-5)
    assert len(frames) == 10  # it hits the end of the box, 70 mm on, after 47 ms


def test_impossible_intervals_are_refused(tmp_path):
    with pytest.raises(BadInput, match="trajectory_interval"):
        heap(trajectory=tmp_path / "heap.gsd", trajectory_interval=0)
    with pytest.raises(BadInput, match="checkpoint_interval"):
        heap(checkpoint=tmp_path / "heap.npz", checkpoint_interval=math.nan)
    with pytest.raises(BadInput, match="suffix"):
        heap(trajectory=tmp_path / "heap.mp4")
    assert list(tmp_path.iterdir()) == []


def lone(*positions, velocity=(0, 0, 0), gravity=(0, 0, -G), fraction=0.3, contact=BEADS) -> Bulk:
    step = fraction * SOFT.rayleigh_time_step
    floor = [Wall(Plane((0, 0, 0), (0, 0, 1)), SOFT.material, contact)]
    run = Bulk([SOFT], contact, floor, low=(-0.1,) * 3, high=(0.1,) * 3, gravity=gravity, time_step=step, threads=1)
    run.add(np.array(positions), np.array(velocity))
    return run


def looked_at(run: Bulk, steps: int, looks: int = 1, trajectory=None) -> Logbook:
    with Logbook(run, {}, trajectory=trajectory, trajectory_interval=5e-3, checkpoint_interval=60) as logbook:
        logbook.resume()
        for _ in range(looks):
            logbook.run(steps)
    return logbook


def test_potential_energy_of_a_falling_bead_becomes_kinetic():
    books = looked_at(lone([0, 0, 0.09]), 200, looks=10).history
    assert books.supplied == pytest.approx(SOFT.mass * G * 0.09)
    assert books.kinetic[-1] == pytest.approx(SOFT.mass * G**2 * books.time[-1] ** 2 / 2, rel=1e-9)
    assert books.kinetic + books.potential == pytest.approx(books.supplied, rel=1e-9)
    assert np.abs(books.dissipated).max() < 1e-9 * books.supplied[0]


@pytest.mark.parametrize("partner", ["floor", "bead"])
def test_in_an_elastic_collision_the_lost_kinetic_energy_is_in_the_spring(partner):
    positions = [[0, 0, 0.0031]] if partner == "floor" else [[0, 0, 0.0501], [0, 0, 0.044]]
    velocity = [[0, 0, -0.5]] if partner == "floor" else [[0, 0, -0.5], [0, 0, 0.5]]
    run = lone(*positions, velocity=velocity, gravity=(0, 0, 0), fraction=0.003, contact=Contact(1.0))
    books = looked_at(run, 10, looks=200).history
    assert books.elastic.max() > 0.999 * books.supplied[0]
    assert books.kinetic + books.elastic == pytest.approx(books.supplied, rel=2e-3)
    assert books.kinetic[-1] == pytest.approx(books.supplied[-1], rel=2e-3)
    assert books.elastic[-1] == 0
    touching = books.contacts + books.wall_contacts
    assert set(touching) == {0, 1}
    assert (books.mean_overlap > 0).tolist() == (touching == 1).tolist()
    assert books.largest_overlap.max() == pytest.approx(run.largest_overlap, rel=1e-4)


def test_the_energy_balance_of_a_pile_closes(whole):
    made, _frames = whole
    books = made.history
    assert books.beads.max() <= 90
    assert np.all(np.diff(books.supplied) >= 0)
    # energy of added beads: half m v^2 at the outlet, and at least the fall height
    speed = float(made.assumptions["outlet_speed"].split()[0])
    least = 90 * D6.mass * (speed**2 / 2 + G * 3 * D6.diameter)
    assert least < books.supplied[-1] < 3 * least
    assert books.risen[-1] < 1e-3 * books.supplied[-1]
    assert np.all(np.diff(books.dissipated) > -1e-3 * books.supplied[-1])
    assert made.statistics["energy_dissipated_j"] == books.dissipated[-1]
    assert made.statistics["kinetic_energy_j"] == pytest.approx(books.kinetic[-1])
    assert 0 < made.statistics["mean_overlap"] < made.statistics["largest_overlap"] < 0.05
    assert made.statistics["contacts"] > len(made.centres)


@pytest.mark.parametrize(("fraction", "closes"), [(0.1, True), (0.3, True), (1.4, False)])
def test_too_large_a_step_shows_as_spurious_energy(fraction, closes):
    # two beads that never lose energy bounce on a floor and on each other
    run = lone([0, 0, 0.0035], [0, 0, 0.0097], fraction=fraction, contact=Contact(1.0))
    logbook = looked_at(run, max(1, round(6 / fraction)), looks=40)
    assert any("energy budget does not close" in warning for warning in logbook.warnings) == (not closes)


FULL_DISK = """
import resource, sys
sys.path[:] = {path!r}
sys.path.insert(0, {tests!r})
import tests.conftest
from pathlib import Path
import numpy as np
from tests.sim.output.test_trajectory import DOMAIN, some_beads
from rigtwin.sim.output import trajectory
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY))
path = Path({file!r})
film = None
try:
    film = trajectory.begin(path, ["D6"], DOMAIN)
    for k in range(60):
        film.add(some_beads(400, k), 0.01 * k, k)
except OSError as error:
    print("full", error.filename)
except Exception as error:
    print("refused", error)
finally:
    if film is not None:
        film.close()
"""


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("limit", [100, 5_000, 30_000, 200_000])
def test_a_full_disk_is_named_and_leaves_nothing_behind(suffix, limit, tmp_path):
    """HDF5 used to end the process with a segmentation fault."""
    file, root = tmp_path / f"x{suffix}", str(Path(__file__).parents[3])
    script = FULL_DISK.format(path=sys.path, tests=root, limit=limit, file=str(file))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(("full", "refused"))
    assert str(file) in done.stdout
    assert not list(tmp_path.iterdir())


def test_two_runs_do_not_write_one_checkpoint(tmp_path):
    with claimed_file(tmp_path / "heap.npz", ""), pytest.raises(BadInput, match="another run is writing"):
        heap(count=2, checkpoint=tmp_path / "heap.npz")
