"""The further experiment that would separate names that explain a lab equally well: twins of it under each name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

from rigtwin.compare.campaign.next_experiment import REPETITIONS, SEEDS, candidates, separations
from rigtwin.compare.campaign.search import results_of
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkCondition, BulkLab
from rigtwin.compare.diagnose.bulk.naming import BulkCandidate
from rigtwin.compare.diagnose.bulk.twin_design import Twins
from rigtwin.compare.diagnose.selection.next_experiment import CLEAR
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.materials import scaled

if TYPE_CHECKING:
    from rigtwin.compare.campaign.campaign import Campaign
from rigtwin.lab.progress import Progress

RIVALS = 3  # names that are compared at most
OTHER_SIZE = 0.6  # size of other beads over the lab's
SEED = 50_000  # added to the seed of the lab's twins


@dataclass(frozen=True)
class FurtherExperiment:
    """An experiment, and how far apart the rivals would be there."""

    words: str
    separation: float  # [standard deviations], of the two rivals that are hardest to separate
    between: tuple[str, str]
    quantity: str
    repetitions: int = REPETITIONS

    def to_json(self) -> dict[str, Any]:
        return {
            "setting": self.words,
            "separation_sigma": self.separation,
            "hardest_pair": list(self.between),
            "quantity": self.quantity,
            "repetitions": self.repetitions,
        }

    @property
    def clear(self) -> bool:
        return self.separation >= CLEAR


def further_experiments(
    twins: Twins, rivals: Sequence[BulkCandidate], campaign: Campaign, progress: Progress
) -> list[FurtherExperiment]:
    """Twins of each possible experiment under each rival; the most separating first."""
    rivals = [one for one in rivals if any(axis.setting is not None for axis in one.point)][:RIVALS]
    if len(rivals) < 2:
        return []
    possible = [one for one in _possible(twins.lab) if _runs(one)]
    runs = {
        (condition.name, k, j): twins.run(condition, rival.point, twins.seed + SEED + j)
        for condition in possible
        for k, rival in enumerate(rivals)
        for j in range(SEEDS)
    }
    done = results_of(list(runs.values()), campaign, progress, "twins of a further experiment")
    twins.asked += len(runs)
    found = []
    for condition in possible:
        apart = []
        for (k, one), (m, other) in combinations(enumerate(rivals), 2):
            sets = [[done.results.get(runs[condition.name, i, j].name) for j in range(SEEDS)] for i in (k, m)]
            if any(result is None for both in sets for result in both):
                continue
            rows = sorted(separations(condition.experiment, sets), key=lambda row: -row["apart"])
            if rows:
                apart.append((rows[0]["apart"], (one.title, other.title), rows[0]["quantity"].replace("_", " ")))
        if len(apart) == math.comb(len(rivals), 2):
            separation, between, quantity = min(apart)
            found.append(FurtherExperiment(condition.name, separation, between, quantity))
    return sorted(found, key=lambda one: -one.separation)


def _possible(lab: BulkLab) -> Iterator[BulkCondition]:
    """Rigs that the lab does not have, and one of its rigs with smaller beads."""
    known = [one.experiment for one in lab.conditions]
    for experiment in candidates(known):
        yield BulkCondition(experiment, ())
    one = known[0]
    bead = scaled(one.particle, OTHER_SIZE)
    rig: Any = one.rig
    lengths = ("base_diameter", "rim_height", "tube_diameter", "cylinder_diameter", "drum_diameter", "depth", "outlet",
               "bin_width", "cone_height", "outlet_height", "outlet_diameter")  # fmt: skip
    lengthened = {name: OTHER_SIZE * value for name in lengths if (value := getattr(rig, name, None)) is not None}
    words = f"the same {one.rig_name} and beads, all {OTHER_SIZE:g} times as large"
    yield BulkCondition(Experiment(words, replace(rig, **lengthened), bead, one.wall, one.camera, ()), ())


def _runs(condition: BulkCondition) -> bool:
    """Whether the twin of an experiment accepts its settings."""
    from rigtwin.compare.twins.registry import entry_of

    try:
        entry_of(condition.experiment).check(condition.experiment, model=Model(), frame_rate=None, count=None)
    except BadInput:
        return False
    return True
