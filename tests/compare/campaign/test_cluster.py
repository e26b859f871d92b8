"""Runs on a cluster: workers of Dask that come, fail and die, and jobs of a batch system."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
import pytest

from rigtwin.compare.campaign import runners
from rigtwin.compare.campaign.campaign import Campaign, run_all
from rigtwin.compare.campaign.run import Run
from rigtwin.compare.campaign.runners import local, runner
from rigtwin.compare.campaign.store import Store
from rigtwin.lab.errors import BadInput, RigtwinError

HERE = "rigtwin.tests.compare.campaign.test_cluster"
ENDS = 20.0  # [s], for a process that was asked to end


def draw(seed, count=100):
    """A short run: seeded numbers and an array of them."""
    time.sleep(0.05)
    found = np.random.default_rng(seed).normal(size=count)
    return {"mean": float(found.mean()), "all": found, "seed": seed}


def refuse(seed):
    raise RigtwinError(f"no bed can be poured from seed {seed}.")


def break_down(seed):
    return {"never": 1 / (seed - seed)}


def runs(count, function="draw", **settings):
    return [Run(f"{function}-{seed}", f"{HERE}:{function}", {"seed": seed, **settings}) for seed in range(count)]


def assert_alike(found, expected):
    """Bit by bit."""
    assert found.keys() == expected.keys()
    for name, result in expected.items():
        assert found[name]["mean"] == result["mean"]
        assert found[name]["all"].tobytes() == result["all"].tobytes()


def ended(process):
    with suppress(subprocess.TimeoutExpired):
        process.terminate()
        process.wait(ENDS)
    process.kill()
    process.wait()


class Cluster:
    """A scheduler and workers of Dask on this machine, each a process of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.log = (folder / "log").open("w")
        contact = folder / "scheduler.json"
        self.scheduler = self._started("dask_scheduler", "--port", "0", "--scheduler-file", str(contact))
        self.workers = []
        self.address = json.loads(self._awaited(lambda: contact.exists() and contact.read_text()))["address"]

    def add_workers(self, count, path=None):
        """Start workers; `path` is a folder that they search for modules first."""
        before = self._number()
        options = ("--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder))
        environment = os.environ if path is None else os.environ | {"PYTHONPATH": str(path)}
        added = [self._started("dask_worker", self.address, *options, env=environment) for _ in range(count)]
        self.workers += added
        self._awaited(lambda: self._number() == before + count)
        return added

    def remove(self, worker):
        self.workers.remove(worker)
        left = self._number() - 1
        ended(worker)
        self._awaited(lambda: self._number() <= left)

    def close(self):
        for process in (*self.workers, self.scheduler):
            process.terminate()
        for process in (*self.workers, self.scheduler):
            ended(process)
        self.log.close()

    def _number(self):
        import distributed

        with distributed.Client(self.address, set_as_default=False) as client:
            return len(client.scheduler_info(n_workers=-1)["workers"])

    def _started(self, module, *options, env=None):
        words = [sys.executable, "-m", f"distributed.cli.{module}", *options, "--host", "127.0.0.1", "--no-dashboard"]
        return subprocess.Popen(words, stdout=self.log, stderr=self.log, env=env, start_new_session=True)

    def _awaited(self, look):
        until = time.monotonic() + 60
        while time.monotonic() < until:
            if found := look():
                return found
            time.sleep(0.1)
        raise TimeoutError((self.folder / "log").read_text())


@contextmanager
def started_cluster(folder) -> Iterator[Cluster]:
    one = Cluster(folder)
    try:
        yield one
    finally:
        one.close()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with started_cluster(tmp_path_factory.mktemp("cluster")) as one:
        one.add_workers(3)
        yield one


def on(cluster, folder):
    return runner(cluster.address, None, folder)


def test_a_worker_killed_in_the_middle_loses_no_run_and_changes_no_result(cluster, tmp_path):
    def kill_one(_stage, done, _whole):
        if done >= 15 and len(cluster.workers) == 3:
            victim = cluster.workers.pop()
            victim.send_signal(signal.SIGKILL)
            victim.wait()

    with Store(tmp_path / "there") as store, Campaign(store, on(cluster, tmp_path)) as campaign:
        found = campaign.results(runs(40), kill_one)
        assert campaign.computed == 40
        rows = store.rows()
    assert len(cluster.workers) == 2
    assert not found.failures
    assert sorted(row.name for row in rows) == sorted(run.name for run in runs(40))
    assert not list((tmp_path / "there").rglob("*.part"))
    expected = run_all(runs(40), tmp_path / "here", runner=lambda jobs: local(jobs, 1))
    assert_alike(found.results, expected.results)


def test_a_run_that_fails_on_a_worker_has_its_own_sentence(cluster, tmp_path):
    asked = [*runs(1, "refuse"), *runs(1, "break_down"), *runs(2)]
    found = run_all(asked, tmp_path, runner=on(cluster, tmp_path))
    assert found.failures["refuse-0"] == "no bed can be poured from seed 0."
    assert found.failures["break_down-0"].startswith("a fault of rigtwin itself (ZeroDivisionError")
    assert "break_down" in found.faults["break_down-0"]
    assert sorted(found.results) == ["draw-0", "draw-1"]


def test_a_worker_with_another_version_is_refused(cluster, tmp_path):
    other = tmp_path / "other" / "rigtwin" / "lab"
    other.mkdir(parents=True)
    for folder in (other, other.parent):
        (folder / "__init__.py").touch()
    (other / "version.py").write_text('__version__ = "0.0.1"')
    (odd,) = cluster.add_workers(1, path=tmp_path / "other")
    try:
        with pytest.raises(BadInput, match=r"the worker tcp://.* has rigtwin 0\.0\.1, this is .*; install the same on"):
            run_all(runs(2), tmp_path / "store", runner=on(cluster, tmp_path))
    finally:
        cluster.remove(odd)


def test_a_scheduler_that_ends_in_the_middle_is_named_and_finished_runs_are_kept(tmp_path):
    def end(_stage, done, _whole):
        if done == 3:
            ended(cluster.scheduler)

    with started_cluster(tmp_path) as cluster:
        with pytest.raises(BadInput, match="has no workers; start some with `dask worker`"):
            run_all(runs(1), tmp_path / "store", runner=on(cluster, tmp_path))
        cluster.add_workers(1)
        with pytest.raises(BadInput, match="has ended or was restarted; start it again, and the same command"):
            run_all(runs(40), tmp_path / "store", runner=on(cluster, tmp_path), progress=end)
    with Store(tmp_path / "store") as store:
        assert 3 <= len(store.rows()) < 40
        assert {row.state for row in store.rows()} == {"done"}


def test_an_unreachable_scheduler_is_one_sentence_within_fifteen_seconds(tmp_path):
    words = [sys.executable, "-m", "rigtwin", "reproduce", "hlosta2020", "--table", "14", "--quick", "--cluster"]
    began = time.monotonic()
    done = subprocess.run([*words, "tcp://127.0.0.1:9"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert time.monotonic() - began < 15
    assert done.returncode == 2
    assert done.stderr.startswith("rigtwin: --cluster: no Dask scheduler answers at tcp://127.0.0.1:9 (")
    assert done.stderr.count("\n") == 1


def test_a_listener_that_is_no_scheduler_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(runners, "ANSWER", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        with pytest.raises(BadInput, match=f"no Dask scheduler answers at {address}"):
            run_all(runs(1), tmp_path, runner=runner(address, None, tmp_path))


@pytest.mark.parametrize(
    ("cluster", "words"),
    [
        ("pbs", "neither the address of a Dask scheduler like tcp://host:8786 nor slurm"),
        ("tcp://host:none", "neither the address of a Dask scheduler"),
        ("tcp://host", "neither the address of a Dask scheduler"),
        ("none://host:1", "neither the address of a Dask scheduler"),
        ("tls://127.0.0.1:9", "tls:// needs certificates"),
        ("slurm:partition", "'partition' is not like partition=long"),
        ("slurm", "slurm cannot be used"),
        ("slurm:cluster=none", "slurm cannot be used"),
        ("slurm:cluster=local,colour=blue", "slurm cannot be used"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_refused(tmp_path, monkeypatch, cluster, words):
    monkeypatch.setenv("PATH", str(tmp_path))  # no sbatch
    with pytest.raises(BadInput, match=words) as refusal:
        run_all(runs(1), tmp_path, runner=runner(cluster, None, tmp_path))
    assert "\n" not in str(refusal.value)


def test_workers_of_this_machine_and_a_cluster_exclude_each_other(tmp_path):
    with pytest.raises(BadInput, match="the cluster decides for itself"):
        runner("slurm", 2, tmp_path)


def test_jobs_of_a_batch_system_give_the_same_results_and_their_own_sentences(tmp_path):
    asked = [*runs(2), *runs(1, "refuse"), *runs(1, "break_down")]
    found = run_all(asked, tmp_path, runner=runner("slurm:cluster=local,timeout_min=5", None, tmp_path))
    expected = run_all(runs(2), tmp_path / "here", runner=lambda jobs: local(jobs, 1))
    assert_alike(found.results, expected.results)
    assert found.failures["refuse-0"] == "no bed can be poured from seed 0."
    assert found.failures["break_down-0"].startswith("a fault of rigtwin itself (ZeroDivisionError")
    assert "break_down" in found.faults["break_down-0"]


def test_a_twin_computed_by_a_worker_is_that_of_this_machine(cluster, tmp_path):
    settings = {"particle": "D6", "seed": 3, "count": 60}
    twin = Run("bed", "rigtwin.compare.reproduce.paper_runs:packing", settings)
    there = run_all([twin], tmp_path / "there", runner=on(cluster, tmp_path))
    here = run_all([twin], tmp_path / "here", runner=lambda jobs: local(jobs, 1))
    assert not there.failures
    timed = {name for name in here.results["bed"] if "second" in name or "time" in name or name == "wall_s"}
    assert {name: value for name, value in there.results["bed"].items() if name not in timed} == {
        name: value for name, value in here.results["bed"].items() if name not in timed
    }
