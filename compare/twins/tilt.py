"""Twin of the tilting plate."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigtwin.compare import curve_overlays
from rigtwin.compare.twins.few_body import FewBodyEntry, as_a_twin, flashes, one_of
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.twin import Twin, settings_of
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.formatting import reading
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Series, Track
from rigtwin.lab.rigs import Tilt, TiltSettings

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement


OTHER_SPEED = 0.05  # relative accuracy with which the speed of a plate is usually set or read

STRETCHES = 4  # parts of a plate's rise whose speeds are compared

LEAST_IN_STRETCH = 5  # smallest number of frames in such a part, so that no single frame determines the slope


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
    particle, one = one_of(particle)
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
        settings_of(
            rig,
            particle,
            {f"{particle.name}-{wall.name}": contact},
            frame_rate_hz=frame_rate,
            numerics=tilt.numerics(rig, particle, effects),
        ),
        tracks=(track,),
        series=(angle,),
        assumptions=(
            *one,
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


def _against_speed(stated: float, measurements: Sequence[Measurement]) -> Iterator[str]:
    """A warning for each film whose plate never rises at a rate near the stated one [deg/s]."""
    for item in measurements:
        rates = _rates(item)
        # the speed of a hand-turned screw varies and the measured rates are noisy: all parts must disagree
        if rates and not (1 - OTHER_SPEED) * min(rates) <= stated <= (1 + OTHER_SPEED) * max(rates):
            found = reading(fmean(rates), stdev(rates), "deg")
            yield (
                f"{item.source.name}: the plate rises by {found} per second, but the lab file states a speed of "
                f"{stated:.3g} deg/s, with which the twin was run; correct the speed, or the camera's frame_rate, to "
                "which the measured speed is proportional"
            )


def _rates(item: Measurement) -> list[float]:
    """Rates [deg/s] at which the plate of a film rises; empty where its angle was not followed."""
    return [rate for angle in item.series if angle.quantity == "plate_angle" for rate in _rising(angle)]


def _rising(angle: Series) -> list[float]:
    """Rates [deg/s] in equal parts of the time in which the plate rises; empty if there are too few frames."""
    known = np.isfinite(angle.value)
    time, turned = angle.time[known], angle.value[known]
    if angle.unit == "rad":
        turned = np.degrees(turned)
    if len(time) < STRETCHES * LEAST_IN_STRETCH:
        return []
    # leave out the time before the plate starts and after it stops, with a margin
    low, high = turned.min(), turned.max()
    under_way = np.flatnonzero((turned > low + 0.2 * (high - low)) & (turned < high - 0.1 * (high - low)))
    if len(under_way) < STRETCHES * LEAST_IN_STRETCH:
        return []
    whole = np.arange(under_way[0], under_way[-1] + 1)
    return [float(np.polyfit(time[part], turned[part], 1)[0]) for part in np.array_split(whole, STRETCHES)]


class TiltEntry(FewBodyEntry[TiltSettings]):
    """The tilting plate in `compare`."""

    settings = TiltSettings
    needs: ClassVar[tuple[str, ...]] = ("static_friction",)

    def needed(self, experiment: Experiment) -> tuple[str, ...]:
        return (*self.needs, "rolling_friction") if self.rig(experiment).variant == "roll" else self.needs

    def completed(self, experiment: Experiment, measurements: Sequence[Measurement]) -> tuple[Experiment, str]:
        rig = self.rig(experiment)
        rates = [fmean(found) for item in measurements if (found := _rates(item))]
        if rig.speed is not None or not rates or fmean(rates) <= 0:
            return experiment, ""
        turned = replace(rig, speed=math.radians(fmean(rates)))
        return replace(experiment, rig=turned), f"a plate that rises by {fmean(rates):.3g} degrees per second"

    def assumed(self, experiment: Experiment, count: int | None) -> list[str]:
        rise = f"a plate that rises by {math.degrees(Tilt.speed):.2g} degree per second"
        return [rise] if self.rig(experiment).speed is None else []

    def known(self, experiment: Experiment) -> dict[str, Any]:
        rig = self.rig(experiment)
        return {"variant": rig.variant, "arm_length": rig.arm_length}

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [
            Stated("plate", rig.arm_length, 1e3, " mm"),
            Stated("tilted by", rig.speed, math.degrees(1), "°/s"),
        ]

    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[curve_overlays.Overlay]:
        return curve_overlays.way_over_angle(measured, twins, experiment.particle.typical.diameter)

    def contradictions(self, experiment: Experiment, measurements: Sequence[Measurement]) -> Iterable[str]:
        speed = self.rig(experiment).speed
        return () if speed is None else _against_speed(math.degrees(speed), measurements)

    def check_trial(self, experiment: Experiment, contact: Contact, frame_rate: float) -> None:
        from rigtwin.sim import tilt

        assert experiment.wall is not None  # the lab file demands one
        bead = experiment.particle.typical
        tilt.check(tilt.Trial(self.rig(experiment).rig(), bead, experiment.wall, contact, frame_rate))

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
