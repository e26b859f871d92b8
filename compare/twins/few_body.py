"""Shared parts of the twins with one or two bodies: pictures, and error messages with advice on settings."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from statistics import fmean
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigtwin.compare.twins.rig_entry import RigEntry, Settings
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.records import Track

FRAME_RATE = 240.0  # [1/s], of the record where there is no film and none is stated, as of `rigtwin simulate`
IDEAL = "The bead moves in a vacuum and does not spin at the start."

if TYPE_CHECKING:
    from rigtwin.compare.twins.twin import Twin
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.file.model_file import Effects, Model
    from rigtwin.lab.materials import Contact
    from rigtwin.lab.progress import Progress
    from rigtwin.lab.quantity import Measurement


def flashes(
    tracks: Sequence[Track], particle: Particle, walls: Array | None, *, turned: float = 0.0
) -> npt.NDArray[np.uint8]:
    """Stroboscopic RGB picture of the particle; a clump is rotated anticlockwise by `turned` [rad]."""
    from rigtwin.sim.output.picture import strobe

    if particle.shape is None:
        return strobe(tracks, [particle.radius], walls=walls)
    from scipy.spatial.transform import Rotation

    offsets = Rotation.from_rotvec([0.0, -turned, 0.0]).apply(np.array(particle.shape.offsets))
    return strobe(tracks, particle.shape.radii, offsets, walls=walls)


def one_of(particle: Particle) -> tuple[Particle, tuple[str, ...]]:
    """The particle of median size by mass, simulated where sizes differ, and the assumption to report."""
    if particle.sizes is None:
        return particle, ()
    bead = particle.typical
    what = f"{1e3 * bead.equivalent_diameter:.3g} mm, the median by mass of its sizes ({particle.sizes.law})"
    return bead, (f"{particle.name} is one particle of {what}.",)


def ground(track: Track, diameter: float) -> Array:
    """Outline of the plate under a fall, for the picture."""
    from rigtwin.sim.output.picture import slab

    across = track.position[:, 0]
    return slab((across.min() - 3 * diameter, -diameter / 2), (across.max() + 3 * diameter, 0.0))


def settings_to_try(faster: str, duration: float | None, greater: str) -> str:
    """List of settings to try; a longer duration only if one was given, as a record is else long enough."""
    return ", ".join([faster, *(["a longer duration"] if duration is not None else []), greater])


@contextmanager
def as_a_twin(rig: str, remedies: str) -> Iterator[None]:
    """Replace the evaluation's advice on filming by advice on settings of the twin, in the error of the block."""
    try:
        yield
    except BadInput as error:
        words = str(error).removeprefix("bead: ").removeprefix("clump: ").removeprefix("the record: ")
        finding = words.rpartition("; ")[0] or words.rstrip(".")
        raise BadInput(f"the twin of the {rig} gives nothing to measure: {finding}; try {remedies}.") from None


class FewBodyEntry(RigEntry[Settings]):
    """A rig of one or two bodies: its twin has the film's frame rate, and starts as measured unless stated."""

    needs: ClassVar[tuple[str, ...]] = ("restitution",)

    def needs_measurement(self, experiment: Experiment) -> bool:
        return bool(experiment.repetitions)

    def check(self, experiment: Experiment, *, model: Model, frame_rate: float | None, count: int | None) -> None:
        if frame_rate is None and not experiment.repetitions:
            frame_rate = _frame_rate(experiment, ())
        if frame_rate is not None:
            self.check_trial(experiment, model.contact(*experiment.contacts[0], self.needed(experiment)), frame_rate)

    @abstractmethod
    def check_trial(self, experiment: Experiment, contact: Contact, frame_rate: float) -> None:
        """Raise `BadInput` where the simulation would refuse its settings at this `frame_rate` [1/s]."""

    def twin(
        self,
        experiment: Experiment,
        contacts: Sequence[Contact],
        *,
        measurements: Sequence[Measurement],
        start: float | None,
        count: int | None,
        seed: int,
        effects: Effects,
        progress: Progress,
        numerics: dict[str, Any],
    ) -> Twin:
        return self.filmed_twin(
            experiment,
            contacts[0],
            start=start,
            measurements=measurements,
            seed=seed,
            frame_rate=_frame_rate(experiment, measurements),
            effects=effects,
            progress=progress,
        )

    @abstractmethod
    def filmed_twin(
        self,
        experiment: Experiment,
        contact: Contact,
        *,
        start: float | None,
        measurements: Sequence[Measurement],
        seed: int,
        frame_rate: float,
        effects: Effects,
        progress: Progress,
    ) -> Twin:
        """Run the twin at the film's `frame_rate` [1/s]."""


def _frame_rate(experiment: Experiment, measurements: Sequence[Measurement]) -> float:
    """[1/s] as stated, else as the clips have it, else from the time steps of tracked records; there may be none."""
    if experiment.camera.frame_rate is not None:
        return experiment.camera.frame_rate
    rates = [float(rate) for item in measurements if (rate := item.camera.get("frame_rate_hz"))]
    rates = rates or [1 / float(np.median(np.diff(track.time))) for item in measurements for track in item.tracks]
    if not rates and not experiment.repetitions:
        return FRAME_RATE
    if not rates:
        raise BadInput(
            f"{experiment.id}: the frame rate is neither stated nor measured; "
            'add frame_rate = "240 Hz" under [experiments.camera].'
        )
    return fmean(rates)
