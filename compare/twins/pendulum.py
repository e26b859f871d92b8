"""Twin of the pendulum: two colliding beads, or a bead against a wall."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rigtwin.compare import curve_overlays
from rigtwin.compare.twins.few_body import IDEAL, FewBodyEntry, as_a_twin, flashes, one_of, settings_to_try
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
    """Simulate a bead that swings against another bead or a vertical wall, and evaluate the tracks.

    Parameters
    ----------
    rig : Pendulum
        Length [m], release angle [rad], variant and hanger.
    particle : Particle
        Bead, or a clump against a wall.
    contact : Contact
        Contact of the beads, or of bead and wall.
    frame_rate : float
        Frame rate of the record [1/s].
    wall : Material, optional
        Material of the wall.
    duration : float, optional
        Length of the record [s]; by default until the beads turn back after the collision.
    effects : Effects
        Additional effects with their coefficients.
    progress : Progress
        Called with step, number and count.

    Returns
    -------
    Twin
        Restitution, angles and tracks.

    Raises
    ------
    BadInput
        If the settings are not possible, or the record cannot be evaluated.
    """
    from rigtwin.measure.pendulum import evaluate as ruler
    from rigtwin.sim import pendulum
    from rigtwin.sim.engine.effect_terms import acting_on_few
    from rigtwin.sim.run.trials import numerics

    begun = time.perf_counter()
    particle, one = one_of(particle)
    acting, left_out = acting_on_few(effects, pivots=True)
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
    # after a steep release the beads move faster, so a greater angle would need more frames and is not advised
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
            numerics=numerics(acting),
        ),
        tracks=tuple(tracks),
        assumptions=(*one, IDEAL, *_hung(rig, particle)),
        warnings=(*_slack(rig), *left_out),
        draw=lambda: flashes(tracks, particle, None if wall is None else _upright(particle.diameter)),
        seconds=time.perf_counter() - begun,
    )


def _upright(diameter: float) -> Array:
    """Outline of the wall, for the picture."""
    from rigtwin.sim.output.picture import slab

    return slab((0.0, -diameter), (diameter / 2, diameter))


def _with_rods(evaluation: Evaluation, rig: Pendulum, particle: Particle) -> Evaluation:
    """Correct the check of gravity for rods with mass, which the evaluation does not consider."""
    if not rig.rod_mass:
        return evaluation
    faster = (particle.mass + rig.rod_mass / 2) / (particle.mass + rig.rod_mass / 3)
    checks, warnings = [], list(evaluation.warnings)
    for check in evaluation.checks:
        if check.check == "gravity" and math.isclose(check.value, faster * check.expected, rel_tol=0.02):
            found = (
                f"gravity from the swing is {check.value:.3f} m/s², {faster:.4g} times its value, as expected for rods "
                "of this mass"
            )
            checks.append(replace(check, passed=True, message=f"{found}."))
            warnings = [words for words in warnings if words != check.message]
        else:
            checks.append(check)
    return replace(evaluation, checks=tuple(checks), warnings=tuple(warnings))


def _hung(rig: Pendulum, particle: Particle) -> tuple[str, ...]:
    """Assumptions on hanger, hinge and clump."""
    if rig.hanger == "string":
        hangs = "Strings have no mass and do not stretch"
    else:
        hangs = "Rods have no mass and do not bend"
        if rig.rod_mass:
            ratio = (particle.mass + rig.rod_mass / 3) / (particle.mass + rig.rod_mass / 2)
            hangs = (
                f"Rods are uniform, have a mass of {1e3 * rig.rod_mass:.3g} g each and do not bend (they swing like "
                f"massless threads of {1e3 * ratio * rig.length:.4g} mm)"
            )
    meets = "the beads meet" if rig.variant == "double" else "the bead meets the wall"
    flat = (f"{particle.name} meets the wall flat and does not turn.",) if particle.shape is not None else ()
    return (f"{hangs}, hinges have no friction, {meets} at the lowest point.", *flat)


def _slack(rig: Pendulum) -> tuple[str, ...]:
    """A warning if a bead on a string is released from above its hinge."""
    if rig.hanger == "rod" or rig.release_angle <= math.pi / 2 * (1 + 1e-9):  # 90 deg in radians may be rounded up
        return ()
    return (
        f"a bead released at {math.degrees(rig.release_angle):.4g} deg falls on a slack string; the twin assumes a "
        "massless rod, so film one, or release at 90 deg or less",
    )


class PendulumEntry(FewBodyEntry[PendulumSettings]):
    """The double pendulum, or one bead against a wall, in `compare`."""

    settings = PendulumSettings
    starts_from: ClassVar[str | None] = "release_angle"

    def known(self, experiment: Experiment) -> dict[str, Any]:
        rig = self.rig(experiment)
        return {"variant": rig.variant, "length": rig.length, "bead_mass": experiment.particle.typical.mass}

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [
            Stated("length", rig.length, 1e3, " mm"),
            Stated("release, stated", rig.release_angle, math.degrees(1), "°"),
        ]

    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[curve_overlays.Overlay]:
        return curve_overlays.angles_over_time(
            measured, twins, self.rig(experiment).length, experiment.particle.typical.diameter
        )

    def stated_start(self, experiment: Experiment) -> float | None:
        angle = self.rig(experiment).release_angle
        return None if angle is None else math.degrees(angle)

    def check_trial(self, experiment: Experiment, contact: Contact, frame_rate: float) -> None:
        from rigtwin.sim import pendulum

        rig = self.rig(experiment)
        if rig.release_angle is not None:
            pendulum.check(pendulum.Trial(rig.rig(), experiment.particle.typical, contact, frame_rate, experiment.wall))

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
