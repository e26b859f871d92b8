"""The methods text of a calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rigtwin.compare.report.methods_text import Methods, listed, software, were
from rigtwin.lab.formatting import counted, title
from rigtwin.lab.reference.bibliography import SOFTWARE

if TYPE_CHECKING:
    from rigtwin.compare.campaign.calibration import Calibration
    from rigtwin.compare.campaign.posterior import Parameter

LIBRARIES = ("numpy", "scipy", "scikit-learn", "emcee", "taichi")
"""Libraries whose versions the text states."""


def methods(found: Calibration, versions: Mapping[str, str]) -> Methods:
    """The methods text of a calibration.

    Parameters
    ----------
    found : Calibration
        The finished calibration.
    versions : mapping of str to str
        Versions of rigtwin, Python and `LIBRARIES`.

    Returns
    -------
    Methods
        Its paragraphs.
    """
    return Methods((("Calibration", " ".join(_sentences(found))), ("Software", software(versions))))


def _sentences(found: Calibration) -> Iterator[str]:
    experiments = listed(f"`{name}`" for name in dict.fromkeys(one.experiment for one in found.targets))
    quantities = listed(dict.fromkeys(title(one.quantity).lower() for one in found.targets))
    yield (
        f"{were(len(found.parameters), 'parameter')} fitted to {counted(len(found.targets), 'measured number')} "
        f"({quantities}) of {experiments} with {found.runs} discrete-element simulations in rigtwin [@{SOFTWARE}]."
    )
    yield f"Priors: {'; '.join(map(_prior, found.parameters))}."
    yield (
        "Each number is emulated by a Gaussian process with one correlation length for each parameter "
        "[@rasmussen2006]; the scatter of the simulation from seed to seed is its noise, and further simulations were "
        f"placed where the posterior is and the emulators are least certain. The search ended: {found.stopped}."
    )
    yield (
        f"The posterior is {len(found.samples)} samples of an affine-invariant ensemble sampler "
        "[@goodman2010; @foreman2013]; intervals are its 2.5 % and 97.5 % quantiles, the best set is the sample of "
        "highest density. Shares of variance are first-order Sobol indices [@saltelli2010]."
    )
    square, probability = found.misfit
    pulls = [f"{name.replace('_', ' ')} by {pull:+.2g}" for name, pull in found.pulls.items()]
    moved = f", with {listed(pulls)} standard uncertainties from the value known beforehand" if pulls else ""
    yield f"The best set has a chi-square of {square:.3g} (probability {probability:.2g}){moved}."
    held = dict.fromkeys(str(row["experiment"]) for row in found.predictions if row["held_out"])
    if held:
        yield f"Held out and predicted: {listed(f'`{name}`' for name in held)}."
    if found.lab.borrowed:
        yield "Values that the lab does not state are those of published tables [@hlosta2020]."


def _prior(one: Parameter) -> str:
    mean = "" if one.mean is None or one.std is None else f"{one.mean:.4g} ± {one.std:.2g}, within "
    shape = "logarithm uniform in " if one.mean is None and one.logarithmic else ""
    return f"{one.name.replace('_', ' ')}: {mean}{shape}{one.low:.4g} to {one.high:.4g} ({one.source})"
