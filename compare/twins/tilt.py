"""Twin of the tilting plate."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigtwin.compare.twins.few_body import FewBodyEntry, as_a_twin, flashes
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.twin import Twin, settings_of
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Series, Track
from rigtwin.lab.rigs import Tilt, TiltSettings

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement


def tilt_twin(
    rig: Tilt,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None = None,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> Twin:
    """Simulate a plate that tilts until the body on it slides or rolls, and evaluate the record.

    Parameters
    ----------
    rig : Tilt
        Variant, plate length [m], speed [rad/s] and start angle [rad].
    particle : Particle
        Body on the plate.
    wall : Material
        Material of the plate.
    contact : Contact
        Contact of body and plate.
    frame_rate : float
        Frame rate of the record [1/s].
    duration : float, optional
        Length of the record [s]; by default until the body has left the plate.
    effects : Effects
        Additional effects with their coefficients.
    progress : Progress
        Called with step, number and count.

    Returns
    -------
    Twin
        Friction coefficients, angle of the plate and track.

    Raises
    ------
    BadInput
        If the settings are not possible, or the record cannot be evaluated.
    """
    from rigtwin.measure.tilt import evaluate as ruler
    from rigtwin.sim import tilt

    begun = time.perf_counter()
    angle, track = tilt.run(
        rig, particle, wall, contact, frame_rate=frame_rate, duration=duration, effects=effects, progress=progress
    )
    progress("reading the record", 0, 0)  # it may take longer than the run
    other = "a longer duration" if duration is not None else "a contact with less friction"
    with as_a_twin("tilt", other):
        evaluation = ruler.evaluate(angle, [track], variant=rig.variant, bead_diameter=particle.diameter)
    return Twin(
        "tilt",
        evaluation,
        settings_of(rig, particle, {f"{particle.name}-{wall.name}": contact}, frame_rate_hz=frame_rate),
        tracks=(track,),
        series=(angle,),
        assumptions=(
            f"The plate rises by {math.degrees(rig.speed):.3g} degrees per second, steadily and without shaking"
            + (f", from {math.degrees(rig.start_angle):.3g} degrees on." if rig.start_angle else "."),
            tilt.body_in_words(rig, particle),
        ),
        warnings=tilt.left_out(rig, particle, effects),
        draw=lambda: _tilted(rig, angle, track, particle),
        seconds=time.perf_counter() - begun,
    )


def _tilted(rig: Tilt, angle: Series, track: Track, particle: Particle) -> npt.NDArray[np.uint8]:
    """Picture of the body on its way down, with the plate at its last angle, as it hardly turns in that time."""
    from rigtwin.sim.output.picture import slab

    end, size = float(angle.value[-1]), particle.diameter
    along = (track.position * np.stack([np.cos(angle.value), np.sin(angle.value)], axis=1)).sum(axis=1)
    left = int(np.argmax(np.abs(along - along[0]) > 0.01 * size))  # 0 if it never moves
    left = min(left, len(along) - 2)
    seen = replace(track, time=track.time[left:], position=track.position[left:], sigma=track.sigma[left:])
    return flashes((seen,), particle, slab((0.0, -size / 2), (rig.plate_length, 0.0), turned=end), turned=end)


class TiltEntry(FewBodyEntry[TiltSettings]):
    """The tilting plate in `compare`."""

    settings = TiltSettings
    needs: ClassVar[tuple[str, ...]] = ("static_friction", "rolling_friction")

    def known(self, experiment: Experiment) -> dict[str, Any]:
        rig = self.rig(experiment)
        return {"variant": rig.variant, "arm_length": rig.arm_length}

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [
            Stated("plate", rig.arm_length, 1e3, " mm"),
            Stated("tilted by", rig.speed, math.degrees(1), "°/s"),
        ]

    def check_trial(self, experiment: Experiment, contact: Contact, frame_rate: float) -> None:
        from rigtwin.sim import tilt

        assert experiment.wall is not None  # the lab file demands one
        tilt.check(tilt.Trial(self.rig(experiment).rig(), experiment.particle, experiment.wall, contact, frame_rate))

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
        assert experiment.wall is not None
        return tilt_twin(
            self.rig(experiment).rig(),
            experiment.particle,
            experiment.wall,
            contact,
            frame_rate=frame_rate,
            effects=effects,
            progress=progress,
        )
