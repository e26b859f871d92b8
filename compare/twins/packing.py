"""Twin of the bed packed in a cylinder."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

from rigtwin.compare import curve_overlays
from rigtwin.compare.twins.many_body import (
    Cast,
    Computed,
    ManyBodyEntry,
    bulk_twin,
    filling_count,
    filling_mass,
    stated_filling,
)
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.twin import Twin, stated
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import PACKING, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import OUTLET_SHARE, Packing, PackingSettings

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement
    from rigtwin.sim.packing import Bed
    from rigtwin.sim.run.set_up import Numerics


def packing_twin(
    rig: Packing,
    cast: Cast,
    *,
    count: int,
    seed: int,
    pour_rate: float | None = None,
    fill_limit: float | None = None,
    settle_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """Simulate a bed of particles poured into a cylinder and evaluate its surface, seen from the sides.

    Parameters
    ----------
    rig : Packing
        Diameter and height of the cylinder [m].
    cast : Cast
        Particle, wall and contacts.
    count : int
        Number of particles.
    seed : int
        Seed of the random numbers.
    pour_rate : float, optional
        Particles per second [1/s], as in `rigtwin.sim.packing.run`.
    fill_limit, settle_limit : float, optional
        Longest times of filling and settling [s], as in `rigtwin.sim.packing.run`.
    progress : Progress
        Called with step, number and count.
    **numerics
        Numerical settings of the run.

    Returns
    -------
    Twin
        Bed height [m], bulk density [kg/m^3] and surface profiles.

    Raises
    ------
    BadInput
        If the settings are not possible, or give no bed that can be evaluated.
    """
    from rigtwin.sim import packing

    begun = time.perf_counter()
    waits = stated(fill_limit=fill_limit, settle_limit=settle_limit)
    bed = packing.run(rig, *cast, count=count, seed=seed, pour_rate=pour_rate, progress=progress, **waits, **numerics)
    return packing_result(rig, cast, bed, Computed(begun, seed, numerics.get("threads")))


def packing_result(rig: Packing, cast: Cast, bed: Bed, computed: Computed) -> Twin:
    """Evaluate a bed that was simulated.

    Parameters
    ----------
    rig : Packing
        The rig.
    cast : Cast
        Particle, wall and contacts.
    bed : Bed
        Result of the run.
    computed : Computed
        How it was computed.

    Returns
    -------
    Twin
        As `packing_twin` returns it.

    Raises
    ------
    BadInput
        If it cannot be evaluated.
    """
    from rigtwin.measure.packing import evaluate as ruler
    from rigtwin.sim import packing
    from rigtwin.sim.run.filling import arch_in_words

    try:
        evaluation = ruler.evaluate(
            bed.profiles,
            cylinder_diameter=rig.cylinder_diameter,
            total_mass=bed.mass,
            bead_diameter=cast.particle.typical.diameter,
        )
    except BadInput as error:
        if bed.arched:
            jam = arch_in_words(f"{bed.stuck} of {bed.placed} particles", bed.outlet_diameter, cast.particle)
            raise BadInput(f"outlet_diameter: {jam}, and leave no bed below; give a wider one.") from error
        layer = _one_layer(rig, cast.particle)
        if bed.stuck or bed.placed - bed.missed >= layer:
            raise
        raise BadInput(
            f"a count of {bed.asked} makes no bed: one layer on the floor of a cylinder of "
            f"{rig.cylinder_diameter * 1e3:.3g} mm has about {layer} particles; give several times as many."
        ) from error
    course = {
        "asked": bed.asked,
        "placed": bed.placed,
        "missed": bed.missed,
        "stuck": bed.stuck,
        "at_rest": bed.at_rest,
        "surface_height_m": bed.height,
        "packing_fraction": bed.packing_fraction,
        "seconds_per_particle": bed.seconds_per_particle,
    }
    shown = bed.profiles, (), lambda: packing.picture(rig, bed)
    twin = bulk_twin("packing", rig, cast, bed, evaluation, computed, course, *shown)
    twin = replace(twin, failed=_no_bed(bed, cast.particle))
    each = bed.seconds_per_particle
    if math.isnan(each):
        return replace(twin, cost="not known: the checkpoint was written by an earlier rigtwin")
    return replace(twin, cost=f"{each:.3g} s of processor time per particle")


def _no_bed(bed: Bed, particle: Particle) -> str:
    """Why there is no bed of the particles that were asked for, with the setting to change; empty where there is."""
    from rigtwin.sim.run.filling import arch_in_words

    inside = bed.placed - bed.missed - bed.stuck
    if inside >= bed.asked / 2:
        return ""
    if bed.arched:
        jam = arch_in_words(f"{bed.stuck} of {bed.placed} particles", bed.outlet_diameter, particle)
        return f"{jam}; give a wider outlet_diameter"
    return (
        f"{inside} of {bed.asked} particles are in the cylinder; give a smaller outlet_diameter or fall_height, or "
        "check cylinder_diameter and count"
    )


def cylinder_for(rig: Packing, particle: Particle, count: int) -> Packing:
    """The rig with a cylinder high enough for `count` particles, with a margin."""
    loose = 2.2 * count * particle.mean_mass / particle.effective_density / (math.pi / 4 * rig.cylinder_diameter**2)
    return replace(rig, cylinder_height=max(rig.cylinder_height, loose))


def _one_layer(rig: Packing, particle: Particle) -> int:
    """Number of particles in one layer on the cylinder's floor."""
    bead = particle.typical
    return math.ceil(PACKING * math.pi / 4 * rig.cylinder_diameter**2 * bead.diameter / particle.mean_volume)


class PackingEntry(ManyBodyEntry[PackingSettings]):
    """The packed cylinder in `compare`."""

    settings = PackingSettings
    run_name: ClassVar[str] = "bed"

    def known(self, experiment: Experiment) -> dict[str, Any]:
        return {
            "cylinder_diameter": self.rig(experiment).cylinder_diameter,
            "spheres": experiment.particle.shape is None and experiment.particle.sizes is None,
            "total_mass": self.filling(experiment),
            "bead_density": experiment.particle.effective_density,
        }

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [
            Stated("cylinder", rig.cylinder_diameter, 1e3, " mm"),
            stated_filling(rig),
        ]

    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[curve_overlays.Overlay]:
        return curve_overlays.outlines(
            "outline of the bed",
            measured,
            twins,
            experiment.particle.typical.diameter,
            self.rig(experiment).cylinder_diameter,
        )

    def filling(self, experiment: Experiment) -> float | None:
        return filling_mass(self.rig(experiment), experiment.particle)

    def takes_count(self, experiment: Experiment) -> bool:
        rig = self.rig(experiment)
        return rig.count is None and rig.total_mass is None

    def count(self, experiment: Experiment, count: int | None) -> int:
        return filling_count(self.rig(experiment), experiment.particle, count)

    def assumed(self, experiment: Experiment, count: int | None) -> list[str]:
        rig = self.rig(experiment)
        found = [f"an outlet of {OUTLET_SHARE:g} of the cylinder"] if rig.outlet_diameter is None else []
        return [*found, f"a fall of {Packing.fall_height * 1e3:.3g} mm"] if rig.fall_height is None else found

    def check_count(self, experiment: Experiment, count: int | None) -> None:
        from rigtwin.sim import packing

        assert count is not None
        packing.check(self.rig(experiment).rig(), experiment.particle, count=count)

    def filled_twin(self, experiment: Experiment, cast: Cast, count: int | None, **run: Any) -> Twin:
        assert count is not None
        rig = cylinder_for(self.rig(experiment).rig(), experiment.particle, count)
        return packing_twin(rig, cast, count=count, **run)
