"""Interrupted runs resume with identical bits; a run that fails keeps its last state."""

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from rigtwin.lab.clumps import row
from rigtwin.lab.errors import BadInput, SimulationFailed
from rigtwin.lab.materials import Contact, Material, Particle, clumped
from rigtwin.lab.rigs import Pile
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.bulk import bulk as engine
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.bulk.checkpoint import Checkpoint
from rigtwin.sim.engine.walls.shapes import Cylinder, Disc, Plane, Wall
from rigtwin.sim.pile import pile
from rigtwin.sim.run.run_log import Logbook

ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
D6 = Particle("D6", ASH, 6e-3, density=569)
BOWL = Pile(0.04, rim_height=0.008, outlet_diameter=0.02)
BEADS, BASE = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)
SOFT = replace(D6, material=ASH.softened(1e-3))
STEP = 0.3 * SOFT.rayleigh_time_step


def heap(**more) -> pile.Heap:
    more = {"count": 90, "seed": 5, "threads": 1, "settle_limit": 0.3} | more
    return pile.run(BOWL, D6, STEEL, BEADS, BASE, **more)


@pytest.fixture(scope="module")
def whole() -> pile.Heap:
    return heap()


def same_end(one: pile.Heap, other: pile.Heap) -> bool:
    """Whether two runs ended with the same bits and the same energy balance."""
    books = all(np.array_equal(getattr(one.history, name), getattr(other.history, name)) for name in vars(one.history))
    return (
        books and np.array_equal(one.centres, other.centres) and (one.time, one.at_rest) == (other.time, other.at_rest)
    )


LOOKS = np.random.default_rng(11).integers(1, 20, 3)  # some of these during pouring, some during settling


@pytest.mark.parametrize("look", [*map(int, LOOKS), 14])
def test_a_broken_run_ends_with_the_bits_of_one_that_never_stopped(broken_off, look, whole, tmp_path):
    broken_off(heap, look, checkpoint=tmp_path / "heap.npz", checkpoint_interval=0)
    assert same_end(heap(checkpoint=tmp_path / "heap.npz"), whole)


def test_a_run_may_be_interrupted_repeatedly(broken_off, whole, tmp_path):
    for look in (3, 2, 5, 1):
        broken_off(heap, look, checkpoint=tmp_path / "heap.npz", checkpoint_interval=0)
    assert same_end(heap(checkpoint=tmp_path / "heap.npz"), whole)


def test_the_run_may_be_interrupted_long_after_its_last_checkpoint(broken_off, whole, tmp_path, monkeypatch):
    class Rare(Checkpoint):
        looks = 0

        @property
        def due(self):
            Rare.looks += 1
            return Rare.looks in (2, 5)

    monkeypatch.setattr("rigtwin.sim.engine.bulk.checkpoint.Checkpoint", Rare)
    broken_off(heap, 9, checkpoint=tmp_path / "heap.npz")
    said = []
    again = heap(checkpoint=tmp_path / "heap.npz", progress=lambda stage, done, total: said.append(stage))
    assert len(said) == len(whole.history.time) - 5
    assert same_end(again, whole)


def test_a_run_interrupted_before_its_first_checkpoint_resumes_from_its_last_check(whole, tmp_path, monkeypatch):
    monkeypatch.setattr("rigtwin.sim.run.run_log.SNAPSHOT_INTERVAL", 0)
    said = []

    def interrupt(stage, done, total):
        said.append(stage)
        if len(said) == 9:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        heap(checkpoint=tmp_path / "heap.npz", progress=interrupt)
    rest = []
    again = heap(checkpoint=tmp_path / "heap.npz", progress=lambda stage, done, total: rest.append(stage))
    assert 0 < len(rest) < len(whole.history.time)
    assert same_end(again, whole)


@pytest.mark.parametrize(("before", "after"), [(1, 2), (2, 1)])
def test_the_number_of_threads_may_change_at_the_break(broken_off, before, after, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "BEADS_PER_THREAD", 1)
    broken_off(heap, 6, checkpoint=tmp_path / "heap.npz", checkpoint_interval=0, threads=before)
    assert same_end(heap(checkpoint=tmp_path / "heap.npz", threads=after), whole)


def test_another_process_resumes_with_the_same_bits(broken_off, whole, tmp_path):
    broken_off(heap, 7, checkpoint=tmp_path / "heap.npz", checkpoint_interval=0)
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import conftest\n"
        "from pathlib import Path; from rigtwin.lab.materials import *; from rigtwin.lab.rigs import Pile\n"
        "from rigtwin.sim.pile import pile\n"
        f"heap = pile.run({BOWL!r}, {D6!r}, {STEEL!r}, {BEADS!r}, {BASE!r},\n"
        "    count=90, seed=5, threads=1, settle_limit=0.3, checkpoint=Path(sys.argv[2]))\n"
        "print(heap.centres.tobytes().hex())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parents[2]), str(tmp_path / "heap.npz")],
        capture_output=True, text=True, check=True, env=os.environ, timeout=300,
    )  # fmt: skip
    assert done.stdout.strip() == whole.centres.tobytes().hex()


def test_checkpoints_and_their_interval_do_not_change_the_bits(whole, tmp_path):
    assert same_end(heap(checkpoint=tmp_path / "heap.npz", checkpoint_interval=0), whole)


def test_a_finished_run_is_not_repeated(whole, tmp_path):
    heap(checkpoint=tmp_path / "heap.npz")
    said = []
    again = heap(checkpoint=tmp_path / "heap.npz", progress=lambda *words: said.append(words))
    assert said == []
    assert same_end(again, whole)


def bed(shapes=(), **more) -> Bulk:
    more = {"time_step": STEP, "threads": 1, "skin": 0.2} | more
    walls = [Wall(shape, SOFT.material, BASE) for shape in shapes]
    return Bulk([SOFT], BEADS, walls, low=(-0.06, -0.06, -0.01), high=(0.06, 0.06, 0.2), **more)


UP = (0.0, 0.0, 1.0)
FLOOR = (Plane((0, 0, 0), UP),)
BOWL_WALLS = (Disc((0, 0, 0), UP, 0.02), Cylinder((0, 0, 0), UP, 0.02, 0.016))


def cluster(seed: int, **more) -> Bulk:
    """Sixty-four beads that fall into a bowl in random order; some bounce out of it."""
    rng = np.random.default_rng(seed)
    start = bed(BOWL_WALLS, open_domain=True, **more)
    k = np.arange(64)
    places = np.stack([k % 4 - 1.5, k // 4 % 4 - 1.5, k // 16 + 1.0], axis=1) * 6.5e-3
    start.add(places, rng.normal(0, 0.4, (64, 3)), rng.normal(0, 30, (64, 3)))
    return start


def same_beads(one: engine.Beads, other: engine.Beads) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in vars(one))


def test_a_state_that_lacks_what_a_step_reads_is_refused():
    state = bed(FLOOR).state()
    for changed in (
        {name: array for name, array in state.items() if name != "push"},
        {**state, "numbers": state["numbers"][:-1]},
        {**state, "given": np.zeros((3, 8))},
    ):
        with pytest.raises(BadInput, match="an earlier rigtwin"):
            bed(FLOOR).restore(changed)


@pytest.mark.parametrize(
    ("pair_capacity", "rolling"),
    [
        (None, "type A"),
        pytest.param(None, "type C", marks=pytest.mark.slow),
        pytest.param(70, "type A", marks=pytest.mark.slow),
        (70, "type C"),
    ],
)
def test_the_state_holds_all_that_later_steps_depend_on(rolling, pair_capacity):
    more = {"rolling": rolling, "pair_capacity": pair_capacity}
    breaks = [0, *np.random.default_rng(3).integers(1, 900, 4).tolist()]  # the first before any list is built
    run = cluster(1, **more)
    states = []
    for steps in breaks:
        run.run(steps)
        states.append((run.state(), run.beads()))
    run.run(4000)
    end, last = run.beads(), (run.time, run.lists_built, run.largest_overlap, run.gone)
    assert run.contacts > 20
    assert run.gone > 0
    for k, (state, then) in enumerate(states):
        cluster(2, **more).run(700)  # leaves its forces and lists in the same memory
        again = bed(BOWL_WALLS, open_domain=True, **more)
        again.restore(state)
        assert same_beads(again.beads(), then)
        again.run(sum(breaks[k + 1 :]) + 4000)
        assert same_beads(again.beads(), end)
        assert (again.time, again.lists_built, again.largest_overlap, again.gone) == last


@pytest.mark.parametrize(
    ("change", "words"),
    [({"seed": 6}, "seed: 5 there, 6 here"), ({"count": 91}, "count"), ({"time_step_fraction": 0.2}, "fraction")],
)
def test_the_checkpoint_of_another_run_is_refused_with_the_differing_setting(broken_off, change, words, tmp_path):
    broken_off(heap, 2, checkpoint=tmp_path / "heap.npz", checkpoint_interval=0)
    with pytest.raises(BadInput, match=f"belongs to another run .*{words}"):
        heap(checkpoint=tmp_path / "heap.npz", **change)


def test_another_contact_makes_another_run(broken_off, tmp_path):
    broken_off(heap, 2, checkpoint=tmp_path / "heap.npz", checkpoint_interval=0)
    with pytest.raises(BadInput, match=r"static friction of the contact: 0.44 there, 0.5 here"):
        pile.run(
            BOWL, D6, STEEL, replace(BEADS, static_friction=0.5), BASE,
            count=90, seed=5, settle_limit=0.3, checkpoint=tmp_path / "heap.npz",
        )  # fmt: skip


def test_the_checkpoint_of_another_device_is_refused(broken_off, tmp_path):
    kept = tmp_path / "heap.npz"
    broken_off(heap, 2, checkpoint=kept, checkpoint_interval=0)
    with np.load(kept) as file:
        arrays = dict(file)
    here = backend.running().device
    there = {"cpu": "cuda", "cuda": "cpu"}[here]
    arrays["words"] = np.array(str(arrays["words"]).replace(f'"device": "{here}"', f'"device": "{there}"'))
    np.savez(kept, **arrays)
    with pytest.raises(BadInput, match=f"device: {there} there, {here} here"):
        heap(checkpoint=kept)


@pytest.mark.parametrize("harm", ["cut", "words", "empty", "array"])
def test_a_damaged_checkpoint_is_refused_in_one_sentence(broken_off, harm, tmp_path):
    path = tmp_path / "heap.npz"
    broken_off(heap, 2, checkpoint=path, checkpoint_interval=0)
    if harm == "array":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    else:
        path.write_bytes({"cut": path.read_bytes()[:5000], "words": b"not a checkpoint", "empty": b""}[harm])
    with pytest.raises(BadInput, match="is not a checkpoint of rigtwin, or is damaged"):
        heap(checkpoint=path)


def test_a_checkpoint_that_cannot_be_completed_leaves_the_last_one_whole(broken_off, whole, tmp_path, monkeypatch):
    path = tmp_path / "heap.npz"
    broken_off(heap, 4, checkpoint=path, checkpoint_interval=0)
    before = path.read_bytes()

    def full(_file):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(BadInput, match=r"cannot be written .*No space left on device"):
            heap(checkpoint=path, checkpoint_interval=0)
    assert path.read_bytes() == before
    assert same_end(heap(checkpoint=path), whole)


def failing(bulk: Bulk, path: Path, steps: int = 100) -> str:
    """Run with a checkpoint at every check until the simulation fails, and return the message."""
    with pytest.raises(SimulationFailed) as failure:
        look_on(bulk, path, steps)
    return str(failure.value)


def look_on(bulk: Bulk, path: Path, steps: int) -> None:
    with logbook(bulk, path) as book:
        book.resume()
        for look in range(100):
            book.run(steps)
            book.look({"look": look})


def logbook(bulk: Bulk, path: Path) -> Logbook:
    return Logbook(bulk, {"case": 1}, trajectory_interval=0.01, checkpoint=path, checkpoint_interval=0)


def test_a_bead_that_leaves_stops_the_run_and_the_last_good_state_is_kept(tmp_path):
    run = bed(gravity=(0, 0, 0))
    run.add([[0, 0, 0.01], [0.03, 0, 0.05]], [[0, 0, 0], [1.5, 0, 0]])
    said = failing(run, tmp_path / "bed.npz")
    # it reaches the end of the box, 30 mm on, after 20 ms; looks are 3.6 ms apart
    assert "bead 1 at t = 0.0" in said
    assert str(tmp_path / "bed.npz") in said
    again = bed(gravity=(0, 0, 0))
    with logbook(again, tmp_path / "bed.npz") as book:
        course = book.resume()
    assert 0.02 - 100 * STEP < again.time < 0.02 + 0.1 * D6.diameter / 1.5
    assert course == {"look": again.steps // 100 - 1}
    assert again.beads().position[1] == pytest.approx([0.03 + 1.5 * again.time, 0, 0.05])


def test_a_snapshot_does_not_contain_later_events(tmp_path, monkeypatch):
    def interrupted(run):
        course = {"seen": []}
        settings = {"trajectory_interval": 0.01, "checkpoint": tmp_path / "bed.npz", "checkpoint_interval": 1e9}
        with Logbook(run, {"case": 1}, **settings) as book:
            for interval in (0, 1e9, 1e9):  # only the first snapshot is kept
                monkeypatch.setattr("rigtwin.sim.run.run_log.SNAPSHOT_INTERVAL", interval)
                book.run(10)
                course["seen"].append(run.steps)
                book.look(course)
            raise KeyboardInterrupt

    run = bed(gravity=(0, 0, 0))
    run.add([[0, 0, 0.01]])
    with pytest.raises(KeyboardInterrupt):
        interrupted(run)
    again = bed(gravity=(0, 0, 0))
    with logbook(again, tmp_path / "bed.npz") as book:
        assert book.resume() == {"seen": [10]}
    assert again.steps == 10


def test_the_compilation_in_the_first_snapshot_does_not_delay_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr("rigtwin.sim.run.run_log.SNAPSHOT_INTERVAL", 0.01)
    calls, read = [], Bulk.state

    def state(self):
        calls.append(time.sleep(0.0 if calls else 0.5))  # like the compilation of kernels
        return read(self)

    monkeypatch.setattr(Bulk, "state", state)

    def interrupted(run):
        settings = {"trajectory_interval": 0.01, "checkpoint": tmp_path / "bed.npz", "checkpoint_interval": 1e9}
        with Logbook(run, {"case": 1}, **settings) as book:
            for look in range(2):
                book.run(10)
                book.look({"look": look})
                time.sleep(0.02)
            raise KeyboardInterrupt

    run = bed(gravity=(0, 0, 0))
    run.add([[0, 0, 0.01]])
    with pytest.raises(KeyboardInterrupt) as stop:
        interrupted(run)
    assert f"kept up to t = {20 * STEP:.4g} s in {tmp_path / 'bed.npz'}" in stop.value.__notes__[0]


def test_a_run_interrupted_before_its_first_check_says_that_nothing_is_kept(tmp_path):
    run = bed(gravity=(0, 0, 0))
    with pytest.raises(KeyboardInterrupt) as stop, logbook(run, tmp_path / "bed.npz"):
        raise KeyboardInterrupt
    assert "nothing of this run was kept yet" in stop.value.__notes__[0]


def test_an_explosion_of_energy_keeps_the_last_state_in_which_all_was_finite(tmp_path):
    run = bed(FLOOR, time_step=20 * STEP)
    k = np.arange(80)
    run.add(np.stack([k % 4, k // 4 % 4, k // 16 + 0.6], axis=1) * 6.3e-3)
    said = failing(run, tmp_path / "bed.npz", steps=5)
    assert "energy exploded: bead" in said
    assert "last good state" in said
    again = bed(FLOOR, time_step=20 * STEP)
    with logbook(again, tmp_path / "bed.npz") as book:
        book.resume()
    assert np.isfinite(again.beads().velocity).all()
    assert 0 < again.steps < run.steps


def test_a_failure_before_the_first_checkpoint_names_none(tmp_path):
    run = bed(gravity=(0, 0, 0))
    run.add([[0.055, 0, 0.05]], [[10.0, 0, 0]])
    assert "kept" not in failing(run, tmp_path / "bed.npz")
    assert not (tmp_path / "bed.npz").exists()


@pytest.fixture
def pellets_of_before(broken_off, tmp_path):
    """An interrupted run of pellets, with a checkpoint of the old format without the rolling lever."""

    def written(rolling):
        kept = tmp_path / "pellets.npz"
        broken_off(pellets, 2, checkpoint=kept, checkpoint_interval=0, rolling=rolling)
        with np.load(kept) as file:
            arrays = dict(file)
        words = json.loads(str(arrays["words"]))
        words["settings"].pop("rolling_lever", None)
        np.savez(kept, **{**arrays, "words": np.array(json.dumps(words))})
        return kept

    return written


def pellets(**more) -> pile.Heap:
    pellet = clumped("pellet", ASH, row(3, 2e-3, 2e-3), mass=60e-6)
    return pile.run(BOWL, pellet, STEEL, BEADS, BASE, **{"count": 20, "seed": 5, "settle_limit": 0.1} | more)


@pytest.mark.slow
def test_clumps_under_type_a_do_not_resume_from_a_checkpoint_with_the_old_lever(pellets_of_before):
    with pytest.raises(BadInput, match=r"another run \(rolling lever: not said there, from a contact to the centre"):
        pellets(checkpoint=pellets_of_before("type A"), rolling="type A")


def test_clumps_under_type_c_resume_from_an_old_checkpoint(pellets_of_before):
    assert pellets(checkpoint=pellets_of_before("type C"), rolling="type C").asked == 20


@pytest.fixture
def members(tmp_path, broken_off) -> dict[str, np.ndarray]:
    broken_off(heap, 6, checkpoint=tmp_path / "whole.npz", checkpoint_interval=0)
    with np.load(tmp_path / "whole.npz") as file:
        return dict(file)


def one_bit(array: np.ndarray) -> np.ndarray:
    stored = bytearray(array.tobytes())
    stored[len(stored) // 2] ^= 1
    return np.frombuffer(bytes(stored), array.dtype).reshape(array.shape)


@pytest.mark.parametrize(
    "change",
    [
        one_bit,
        lambda array: array[:-1] if array.ndim else array + 1,
        lambda array: array.astype(np.float32 if array.dtype != np.float32 else np.float64),
        lambda array: np.full_like(array, np.nan) if array.dtype.kind == "f" else np.full_like(array, 99),
    ],
)
def test_a_checkpoint_with_other_members_is_refused_whatever_its_checksums(change, members, tmp_path):
    path = tmp_path / "heap.npz"
    settings = json.loads(str(members["words"]))["settings"]
    names = sorted(name for name in members if name.startswith("state_") and members[name].size)
    for name in names[:: max(1, len(names) // 6)]:
        np.savez(path, **{**members, name: change(members[name])})
        with pytest.raises(BadInput, match=r"does not hold what was written|not a checkpoint"):
            Checkpoint(path, settings, 1).read()
    np.savez(path, **{name: array for name, array in members.items() if name != names[0]})
    with pytest.raises(BadInput, match="does not hold what was written"):
        heap(checkpoint=path)


def test_a_checkpoint_that_would_not_fit_into_memory_is_refused_before_it_takes_any(tmp_path):
    path = tmp_path / "heap.npz"
    np.savez_compressed(path, words=np.zeros(10**7))
    with pytest.raises(BadInput, match="not a checkpoint"):
        Checkpoint(path, {}, 1).read()
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + b"\n"
    with ZipFile(path, "w") as file:
        file.writestr("words.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(800))
    with pytest.raises(BadInput, match="not a checkpoint"):
        Checkpoint(path, {}, 1).read()


@pytest.mark.parametrize(
    "change",
    [
        lambda course, state: state.update(sizes=np.arange(6)),
        lambda course, state: state.update(sizes=np.zeros(3, dtype=int)),
        lambda course, state: state.update(owners=state["owners"][:1]),
        lambda course, state: state.update(first=np.full_like(state["first"], 2**31 - 1)),
        lambda course, state: state.update(place=np.full_like(state["place"], 1e300)),
        lambda course, state: state.pop("steps"),
        lambda course, state: course.update(energy=[1.0]),
        lambda course, state: course["history"][0].update(in_flight=[]),
        lambda course, state: course["history"].append("nothing"),
        lambda course, state: course["course"].update(quiet="often"),
        lambda course, state: course["course"].update(unknown=1),
        lambda course, state: course["course"].update(random={"bit_generator": "PCG64"}),
    ],
)
def test_a_checkpoint_that_holds_no_state_of_the_run_is_refused_whatever_its_checksums(change, members, tmp_path):
    path = tmp_path / "heap.npz"
    words = json.loads(str(members["words"]))
    state = {name.removeprefix("state_"): array for name, array in members.items() if name.startswith("state_")}
    change(words["course"], state)
    Checkpoint(path, {k: v for k, v in words["settings"].items() if k != "rigtwin"}, 1).write(words["course"], state, 0)
    with pytest.raises(BadInput, match="holds no state of this run"):
        heap(checkpoint=path)
