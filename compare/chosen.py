"""Experiments of a lab by name, and what is known beforehand of their scatter."""

from __future__ import annotations

from collections.abc import Sequence

from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab
from rigtwin.lab.reference.repetition_scatter import Scatter, published_scatter
from rigtwin.lab.spelling import suggestion


def chosen(lab: Lab, only: Sequence[str] | None) -> tuple[Experiment, ...]:
    """Return the experiments with these names, or all.

    Parameters
    ----------
    lab : Lab
        Lab that holds the experiments.
    only : sequence of str or None
        Names of experiments; None or empty: all.

    Returns
    -------
    tuple of Experiment
        In the order of the lab file.

    Raises
    ------
    BadInput
        If the lab does not have one of the names.
    """
    if not only:
        return lab.experiments
    known = [experiment.id for experiment in lab.experiments]
    for name in only:
        if name not in known:
            raise BadInput(f"{lab.path}: there is no experiment {name!r}; {suggestion(name, known)}.")
    return tuple(experiment for experiment in lab.experiments if experiment.id in only)


def known_scatter(experiment: Experiment, quantity: str) -> Scatter:
    """Return the scatter of a quantity from repetition to repetition: as lab.toml states it, else as published.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose repetitions scatter.
    quantity : str
        Name of the quantity.

    Returns
    -------
    Scatter
        Relative standard deviation [1], and how well it is known.
    """
    return experiment.scatter.get(quantity) or published_scatter(experiment.rig_name, quantity)
