"""Many trials of a rig with few bodies, simulated in parallel and sampled by a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.lab.progress import Progress
from rigtwin.sim.engine.time_step import of_kind

if TYPE_CHECKING:
    from rigtwin.sim.engine.effect_terms import Active
    from rigtwin.sim.engine.few.few_body import Case

_Trial = TypeVar("_Trial")
_Ready = TypeVar("_Ready")

FRAMES_AT_REST = 5  # frames before the release
TRACK_SIGMA = 1e-6  # [m], standard uncertainty; the step is halved until positions change by less


@dataclass(frozen=True, eq=False)
class Release:
    """Bodies that are at rest for some frames and are then released."""

    time: Array  # [s], of all frames, shape (k,)
    case: Case  # from the release on


@dataclass(frozen=True, eq=False)
class Seen:
    """Positions of the bodies in each frame."""

    time: Array  # [s], shape (k,)
    position: Array  # [m], shape (k, n, 3)
    sigma: Array  # [m], shape (k,)


def each(trials: Sequence[_Trial], kind: type[_Trial], prepare: Callable[[_Trial], _Ready]) -> Iterator[_Ready]:
    """Prepare the trials one after the other.

    Parameters
    ----------
    trials : sequence
        Trials to be prepared.
    kind : type
        The type that all of them must have.
    prepare : callable
        Takes a trial and returns what is simulated.

    Yields
    ------
    object
        What `prepare` returns.

    Raises
    ------
    BadInput
        If a trial is refused; of many the message names the trial.
    """
    for k, trial in enumerate(trials):
        try:
            of_kind(trial, kind)
            yield prepare(trial)
        except BadInput as error:
            raise type(error)(f"{name(k, trials)}: {error}" if len(trials) > 1 else str(error)) from None


def name(place: int, trials: Sequence[object]) -> str:
    """Return the name of a trial in error messages.

    Parameters
    ----------
    place : int
        Its number, from 0.
    trials : sequence
        All trials.

    Returns
    -------
    str
        Empty for a single one.
    """
    return f"trials[{place}]" if len(trials) > 1 else ""


def released(time: Array, frame_rate: float) -> Array:
    """Return the times of the frames after the release.

    Parameters
    ----------
    time : ndarray, shape (k,)
        Times of all frames [s].
    frame_rate : float
        Frames per second [1/s].

    Returns
    -------
    ndarray
        Times since the release [s].
    """
    return time[FRAMES_AT_REST + 1 :] - FRAMES_AT_REST / frame_rate


def numerics(active: Sequence[Active]) -> dict[str, str]:
    """Describe the numerical settings of `film`, and the effects that act.

    Parameters
    ----------
    active : sequence of Active
        Effects that act.

    Returns
    -------
    dict of str to str
        Settings in words, by name.
    """
    from rigtwin.sim.engine.effect_terms import named_in
    from rigtwin.sim.engine.few.few_body import Case

    return {
        "contact_law": Case.contact_law,
        "stiffness_factor": "1 (the real Young's moduli)",
        "time_step": f"halved in contact until no position changes by more than {1e6 * TRACK_SIGMA:g} um",
        **named_in(active),
    }


def film(releases: Sequence[Release], *, threads: int | None = None, progress: Progress) -> list[Seen | RigtwinError]:
    """Simulate releases in one launch; the step is halved until positions converge.

    Parameters
    ----------
    releases : sequence of Release
        The bodies and the times of the frames.
    threads : int, optional
        Number of threads.  Default: all cores.
    progress : Progress
        Callback for the progress display.

    Returns
    -------
    list of Seen or RigtwinError
        The record of each release; for one that breaks down its error.
    """
    from rigtwin.sim.engine.few.few_body import run_many_halved

    moving = [k for k, release in enumerate(releases) if len(release.case.times)]
    cases = [replace(releases[k].case, name=name(k, releases)) for k in moving]
    motions = run_many_halved(cases, tolerance=TRACK_SIGMA, threads=threads, progress=progress)
    found = dict(zip(moving, motions, strict=True))
    seen: list[Seen | RigtwinError] = []
    for k, release in enumerate(releases):
        frames = len(release.time)
        position = np.tile([body.position for body in release.case.bodies], (frames, 1, 1))
        sigma, motion = TRACK_SIGMA, found.get(k)
        if isinstance(motion, RigtwinError):
            seen.append(motion)
            continue
        if motion is not None:
            position[FRAMES_AT_REST + 1 :] = motion[0].position
            sigma = max(sigma, motion[1])
        seen.append(Seen(release.time, position, np.full(frames, sigma)))
    return seen
