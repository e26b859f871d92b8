from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rigtwin.compare.twins.few_body import IDEAL, FewBodyEntry, as_a_twin, flashes, settings_to_try
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.twin import Twin, settings_of
from rigtwin.lab.arrays import Array
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Evaluation
from rigtwin.lab.rigs import GRAVITY, Pendulum, PendulumSettings

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement


def pendulum_twin(
    rig: Pendulum,
    particle: Particle,
    contact: Contact,
    *,
    frame_rate: float,
    wall: Material | None = None,
    duration: float | None = None,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> Twin:
    """Bead A swinging against bead B, or against an upright `wall`.

    The record is taken at `frame_rate` [1/s] for `duration` [s] or until the beads have turned.
    """
    from rigtwin.measure.pendulum import evaluate as ruler
    from rigtwin.sim import pendulum
    from rigtwin.sim.engine.effect_terms import acting_on_few

    begun = time.perf_counter()
    tracks = pendulum.run(
        rig,
        particle,
        contact,
        wall=wall,
        frame_rate=frame_rate,
        duration=duration,
        effects=effects,
        progress=progress,
    )
    # the steeper the release, the faster the beads pass each other: that asks for more frames, not for a greater angle
    shallow = "a greater release angle or length" if rig.release_angle < math.pi / 4 else "a greater length"
    with as_a_twin("pendulum", settings_to_try("a higher frame rate", duration, shallow)):
        evaluation = ruler.evaluate(
            tracks, variant=rig.variant, length=rig.length, bead_diameter=particle.diameter, bead_mass=None
        )
    evaluation = _with_rods(evaluation, rig, particle)
    other = particle.name if wall is None else wall.name
    return Twin(
        "pendulum",
        evaluation,
        settings_of(
            rig,
            particle,
            {f"{particle.name}-{other}": contact},
            frame_rate_hz=frame_rate,
        ),
        tracks=tuple(tracks),
        assumptions=(IDEAL, *_hung(rig, particle)),
        warnings=(*_slack(rig), *acting_on_few(effects, pivots=True)[1]),
        draw=lambda: flashes(tracks, particle, None if wall is None else _upright(particle.diameter)),
        seconds=time.perf_counter() - begun,
    )


def _upright(diameter: float) -> Array:
    """The wall that a pendulum meets."""
    from rigtwin.sim.output.picture import slab

    return slab((0.0, -diameter), (diameter / 2, diameter))


def _with_rods(evaluation: Evaluation, rig: Pendulum, particle: Particle) -> Evaluation:
    """The ruler does not know of rods with mass and takes the faster swing for another gravity."""
    if not rig.rod_mass:
        return evaluation
    faster = (particle.mass + rig.rod_mass / 2) / (particle.mass + rig.rod_mass / 3)
    checks, warnings = [], list(evaluation.warnings)
    for check in evaluation.checks:
        if check.check == "gravity" and math.isclose(check.value, faster * check.expected, rel_tol=0.02):
            told = (
                f"gravity from the swing is {check.value:.3f} m/s², {faster:.4g} times its value as such rods make it"
            )
            checks.append(replace(check, passed=True, message=f"{told}."))
            warnings = [words for words in warnings if words != check.message]
        else:
            checks.append(check)
    return replace(evaluation, checks=tuple(checks), warnings=tuple(warnings))


def _hung(rig: Pendulum, particle: Particle) -> tuple[str, ...]:
    """What is taken of hanger and hinge, and of a clump."""
    if rig.hanger == "string":
        hangs = "Strings have no mass and do not stretch"
    else:
        hangs = "Rods have no mass and do not bend"
        if rig.rod_mass:
            ratio = (particle.mass + rig.rod_mass / 3) / (particle.mass + rig.rod_mass / 2)
            hangs = (
                f"Rods are uniform, weigh {1e3 * rig.rod_mass:.3g} g each and do not bend (they swing as threads of "
                f"{1e3 * ratio * rig.length:.4g} mm without mass do)"
            )
    meets = "the beads meet" if rig.variant == "double" else "the bead meets the wall"
    flat = (f"{particle.name} meets the wall flat and does not turn.",) if particle.shape is not None else ()
    return (f"{hangs}, hinges do not rub, {meets} at the lowest point.", *flat)


def _slack(rig: Pendulum) -> tuple[str, ...]:
    """What to say of a bead on a string that is let go from above its hinge."""
    if rig.hanger == "rod" or rig.release_angle <= math.pi / 2 * (1 + 1e-9):  # 90 deg in radians may be rounded up
        return ()
    return (
        f"a bead let go at {math.degrees(rig.release_angle):.4g} deg falls on a slack string; the twin holds for a rod "
        "without mass, so film one, or release at 90 deg or less",
    )


class PendulumEntry(FewBodyEntry[PendulumSettings]):
    """The double pendulum, or one bead against a wall, in `compare`."""

    settings = PendulumSettings
    starts_from: ClassVar[str | None] = "release_angle"

    def known(self, experiment: Experiment) -> dict[str, Any]:
        rig = self.rig(experiment)
        return {"variant": rig.variant, "length": rig.length, "bead_mass": experiment.particle.mass}

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [
            Stated("length", rig.length, 1e3, " mm"),
            Stated("release, stated", rig.release_angle, math.degrees(1), "°"),
        ]

    def stated_start(self, experiment: Experiment) -> float | None:
        angle = self.rig(experiment).release_angle
        return None if angle is None else math.degrees(angle)

    def check_trial(self, experiment: Experiment, contact: Contact, frame_rate: float) -> None:
        from rigtwin.sim import pendulum

        rig = self.rig(experiment)
        if rig.release_angle is not None:
            pendulum.check(pendulum.Trial(rig.rig(), experiment.particle, contact, frame_rate, experiment.wall))

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
        rig = self.rig(experiment).rig(None if start is None else math.radians(start))
        return pendulum_twin(
            rig,
            experiment.particle,
            contact,
            frame_rate=frame_rate,
            wall=experiment.wall,
            duration=_filmed_duration(rig, frame_rate, measurements),
            effects=effects,
            progress=progress,
        )


def _filmed_duration(rig: Pendulum, rate: float, measurements: Sequence[Measurement]) -> float:
    """[s] as long as the films, so that later collisions have their twin, and until the beads have turned."""
    film = max((float(np.ptp(track.time)) for item in measurements for track in item.tracks), default=0.0)
    period = 2 * math.pi * math.sqrt(rig.length / GRAVITY) * (1 + rig.release_angle**2 / 16)
    return max(film, 0.6 * period + 5 / rate)
