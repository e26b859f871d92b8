"""Experiments of a lab by name, and what is known beforehand of their scatter."""

from __future__ import annotations

from collections.abc import Sequence

from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab
from rigtwin.lab.file.schema import suggestion
from rigtwin.lab.reference.repetition_scatter import Scatter, published_scatter


def chosen(lab: Lab, only: Sequence[str] | None) -> tuple[Experiment, ...]:
    """The experiments with these names, or all.  Raises `BadInput` for a name that the lab does not have."""
    if not only:
        return lab.experiments
    known = [experiment.id for experiment in lab.experiments]
    for name in only:
        if name not in known:
            raise BadInput(f"{lab.path}: there is no experiment {name!r}; {suggestion(name, known)}.")
    return tuple(experiment for experiment in lab.experiments if experiment.id in only)


def known_scatter(experiment: Experiment, quantity: str) -> Scatter:
    """The scatter of a quantity from repetition to repetition: as lab.toml states it, else as published."""
    return experiment.scatter.get(quantity) or published_scatter(experiment.rig_name, quantity)
