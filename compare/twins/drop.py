"""Twin of the drop test: a bead or a clump on a plate."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

from rigtwin.compare import curve_overlays
from rigtwin.compare.twins.few_body import IDEAL, FewBodyEntry, as_a_twin, flashes, ground, one_of, settings_to_try
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.twin import Twin, settings_of
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import GRAVITY, Drop, DropSettings

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement


def drop_twin(
    rig: Drop,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None = None,
    seed: int = 1,
    effects: Effects = NO_EFFECTS,
    progress: Progress = silent,
) -> Twin:
    """Simulate a bead or a clump dropped on a plate and evaluate its track.

    Parameters
    ----------
    rig : Drop
        Drop height [m] and number of bounces.
    particle : Particle
        Bead or clump.
    wall : Material
        Material of the plate.
    contact : Contact
        Contact of particle and plate.
    frame_rate : float
        Frame rate of the record [1/s].
    duration : float, optional
        Length of the record [s]; by default as long as the bounces of the rig take.
    seed : int
        Seed of the random orientation of a clump, if the rig does not state one.
    effects : Effects
        Additional effects with their coefficients.
    progress : Progress
        Called with step, number and count.

    Returns
    -------
    Twin
        Restitution, heights and tracks.

    Raises
    ------
    BadInput
        If the settings are not possible, or the record cannot be evaluated.
    """
    from rigtwin.measure.drop import evaluate as ruler
    from rigtwin.sim import drop
    from rigtwin.sim.engine.effect_terms import acting_on_few
    from rigtwin.sim.run.trials import numerics

    particle, one = one_of(particle)
    if particle.shape is not None:
        twin = _tumbling_twin(
            rig,
            particle,
            wall,
            contact,
            frame_rate=frame_rate,
            duration=duration,
            seed=seed,
            effects=effects,
            progress=progress,
        )
        return replace(twin, assumptions=(*one, *twin.assumptions))
    begun = time.perf_counter()
    acting, left_out = acting_on_few(effects)
    track = drop.run(
        rig, particle, wall, contact, frame_rate=frame_rate, duration=duration, effects=effects, progress=progress
    )
    flight = 2 * contact.restitution * math.sqrt(2 * rig.drop_height / GRAVITY)  # [s], of the first rebound
    rises = 1e3 * contact.restitution**2 * rig.drop_height
    higher = f"a greater drop height or restitution (the first rebound rises {rises:.2g} mm in {flight:.2g} s)"
    with as_a_twin("drop", settings_to_try("a higher frame rate", duration, higher)):
        evaluation = ruler.evaluate(track, bead_diameter=particle.diameter, bead_density=None)
    return Twin(
        "drop",
        evaluation,
        settings_of(
            rig,
            particle,
            {f"{particle.name}-{wall.name}": contact},
            frame_rate_hz=frame_rate,
            numerics=numerics(acting),
        ),
        tracks=(track,),
        assumptions=(*one, IDEAL, "The plate is flat, level and does not move."),
        warnings=left_out,
        draw=lambda: flashes((track,), particle, ground(track, particle.diameter)),
        seconds=time.perf_counter() - begun,
    )


def _tumbling_twin(
    rig: Drop,
    particle: Particle,
    wall: Material,
    contact: Contact,
    *,
    frame_rate: float,
    duration: float | None,
    seed: int,
    effects: Effects,
    progress: Progress,
) -> Twin:
    """A clump dropped on a plate, seen from the front and from the side."""
    from rigtwin.measure.drop import evaluate as ruler
    from rigtwin.sim import drop_clump
    from rigtwin.sim.engine.effect_terms import acting_among

    begun = time.perf_counter()
    fall = drop_clump.run(
        rig,
        particle,
        wall,
        contact,
        frame_rate=frame_rate,
        duration=duration,
        seed=seed,
        effects=effects,
        progress=progress,
    )
    other = "another seed or turn" if rig.turned is None else "another turn"
    with as_a_twin("drop", f"{other}, a greater drop height or restitution, or a higher frame rate"):
        evaluation = ruler.evaluate(fall.front, side=fall.side)
    turned = f"at random (seed {seed})" if rig.turned is None else f"by {math.degrees(rig.turned):.4g} degrees"
    return Twin(
        "drop",
        evaluation,
        settings_of(
            rig,
            particle,
            {f"{particle.name}-{wall.name}": contact},
            frame_rate_hz=frame_rate,
            seed=seed,
            numerics=drop_clump.numerics(particle, effects),
        ),
        tracks=(fall.front, fall.side),
        assumptions=(
            IDEAL,
            "The plate is flat, level and does not move.",
            f"The clump falls turned {turned}; direction and speed of its rebound depend on that, so one fall is a "
            f"single sample. Its contact has a restitution of {contact.restitution:g}.",
            "Each sphere of the clump in contact with the plate is damped separately: a face that lands flat rebounds "
            "less than the restitution.",
        ),
        warnings=acting_among(effects, particle)[1],
        draw=lambda: drop_clump.picture(fall, particle, walls=ground(fall.front, particle.diameter)),
        seconds=time.perf_counter() - begun,
    )


class DropEntry(FewBodyEntry[DropSettings]):
    """The drop test in `compare`."""

    settings = DropSettings
    starts_from: ClassVar[str | None] = "drop_height"

    def known(self, experiment: Experiment) -> dict[str, Any]:
        return {"bead_density": experiment.particle.effective_density}

    def stated(self, experiment: Experiment) -> list[Stated]:
        return [Stated("drop height, stated", self.rig(experiment).drop_height, 1e3, " mm")]

    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[curve_overlays.Overlay]:
        return curve_overlays.height_over_time(measured, twins, experiment.particle.typical.diameter)

    def stated_start(self, experiment: Experiment) -> float | None:
        return self.rig(experiment).drop_height  # [m]

    def keys_to_state(self, experiment: Experiment) -> list[str]:
        values = {
            "drop_height": self.stated_start(experiment),
            "frame_rate of [experiments.camera]": experiment.camera.frame_rate,
        }
        return [key for key, value in values.items() if value is None]

    def needs_measurement(self, experiment: Experiment) -> bool:
        return super().needs_measurement(experiment) and bool(self.keys_to_state(experiment))

    def check_trial(self, experiment: Experiment, contact: Contact, frame_rate: float) -> None:
        from rigtwin.sim import drop

        if self.rig(experiment).drop_height is None:
            return
        assert experiment.wall is not None  # the lab file demands one
        bead = experiment.particle.typical
        drop.check(drop.Trial(self.rig(experiment).rig(), bead, experiment.wall, contact, frame_rate))

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
        return drop_twin(
            self.rig(experiment).rig(start),
            experiment.particle,
            experiment.wall,
            contact,
            frame_rate=frame_rate,
            seed=seed,
            effects=effects,
            progress=progress,
        )
