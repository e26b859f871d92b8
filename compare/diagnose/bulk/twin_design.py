"""Which twins are run: the stated setting with several seeds, each axis at a few coordinates, then likely effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rigtwin.compare.campaign.campaign import Campaign
from rigtwin.compare.campaign.run import Run
from rigtwin.compare.campaign.search import results_of
from rigtwin.compare.campaign.twin_runs import twin_run
from rigtwin.compare.diagnose.bulk.axes import Axis, acts, twin_setting
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkCondition, BulkLab
from rigtwin.compare.diagnose.bulk.response import Twinned
from rigtwin.lab.progress import Progress

MOST_RUNS = 40  # of a condition
CENTRAL = 6  # runs of the stated setting
AGAIN = (1.0, 1.0, 0.7)  # coordinates over the fitted one at which a likely candidate is run again
SEEDS = 10_000  # between those of two stages


@dataclass
class Twins:
    """The runs of a lab so far."""

    lab: BulkLab
    axes: tuple[Axis, ...]
    seed: int
    runs: dict[str, list[Twinned]] = field(default_factory=dict)  # by condition
    failures: dict[str, str] = field(default_factory=dict)
    asked: int = 0

    def left(self, condition: BulkCondition) -> int:
        """Number of runs that a condition may still have."""
        return MOST_RUNS - len(self.runs.get(condition.name, ()))

    def first(self, campaign: Campaign, progress: Progress) -> None:
        """The first look: centre and axes."""
        planned = []
        for condition in self.lab.conditions:
            points: list[Mapping[Axis, float]] = [{}] * CENTRAL
            points += [{axis: level} for axis in self.axes if acts(axis, condition) for level in axis.levels]
            planned += [(condition, point) for point in points[:MOST_RUNS]]
        self._run(planned, campaign, progress, "twins about the stated setting", 0)

    def again(
        self, candidates: Sequence[Mapping[Axis, float]], campaign: Campaign, progress: Progress, stage: int
    ) -> int:
        """A second look around fitted candidates, as far as runs are left; returns their number."""
        planned = []
        for condition in self.lab.conditions:
            mine = [
                {axis: u * part for axis, u in point.items() if axis.levels and acts(axis, condition)}
                for part in AGAIN
                for point in candidates
            ]
            planned += [(condition, point) for point in [one for one in mine if one][: self.left(condition)]]
        self._run(planned, campaign, progress, "twins of the likely effects", stage)
        return len(planned)

    def _run(
        self, planned: Sequence[tuple[BulkCondition, Mapping[Axis, float]]], campaign: Campaign, progress: Progress,
        stage_name: str, stage: int,
    ) -> None:  # fmt: skip
        runs, numbered = [], Counter[str]()
        for condition, point in planned:  # each condition counts its own seeds, so that labs share the twins of one rig
            runs.append(self.run(condition, point, self.seed + stage * SEEDS + numbered[condition.name]))
            numbered[condition.name] += 1
        done = results_of(runs, campaign, progress, stage_name)
        self.failures.update(done.failures)
        self.asked += len(runs)
        for run, (condition, point) in zip(runs, planned, strict=True):
            if run.name in done.results:
                self.runs.setdefault(condition.name, []).append(Twinned(point, done.results[run.name]))

    def run(self, condition: BulkCondition, point: Mapping[Axis, float], seed: int) -> Run:
        """The run of a condition's twin at coordinates."""
        where = ", ".join(f"{axis.name} {u:+.3f}" for axis, u in point.items()) or "as stated"
        name = f"{condition.name}, {where}, seed {seed}"
        setting = twin_setting(self.lab, condition, point)
        return twin_run(name, *setting, seed=seed, stiffness_factor=self.lab.stiffness_factor(condition))
