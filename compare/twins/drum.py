"""Twin of the rotating drum."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any, Unpack

from rigtwin.compare import curve_overlays
from rigtwin.compare.twins.many_body import Cast, Computed, ManyBodyEntry, bulk_twin
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.run_cost import need_usual_number
from rigtwin.compare.twins.twin import Twin, stated
from rigtwin.lab.drum_flow import FILL, FLOWING, froude_check
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.materials import PACKING, Particle
from rigtwin.lab.media_files import PICTURES
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import doubted, failed
from rigtwin.lab.rigs import Drum, DrumSettings

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement
    from rigtwin.sim.drum import Rotation
    from rigtwin.sim.run.set_up import Numerics


def drum_twin(
    rig: Drum,
    cast: Cast,
    *,
    seed: int,
    count: int | None = None,
    turns: float = 1.0,
    fill_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """Simulate a bed in a rotating drum and evaluate its surface, seen along the axis.

    Parameters
    ----------
    rig : Drum
        Diameter [m], speed [rad/s], depth [m] and fill.
    cast : Cast
        Particle, wall and contacts.
    seed : int
        Seed of the random numbers.
    count : int, optional
        Number of particles; by default the fill of the rig.
    turns : float
        Revolutions of the drum.
    fill_limit : float, optional
        Longest time of filling [s], as in `rigtwin.sim.drum.run`.
    progress : Progress
        Called with step, number and count.
    **numerics
        Numerical settings of the run.

    Returns
    -------
    Twin
        Dynamic angles of repose [deg], mixing index and surface profiles.

    Raises
    ------
    BadInput
        If the settings are not possible, or give no surface that can be evaluated.
    """
    from rigtwin.sim import drum

    begun = time.perf_counter()
    waits = stated(fill_limit=fill_limit)
    rotation = drum.run(rig, *cast, count=count, turns=turns, seed=seed, progress=progress, **waits, **numerics)
    return drum_result(rig, cast, rotation, Computed(begun, seed, numerics.get("threads")), count=count)


def drum_result(rig: Drum, cast: Cast, rotation: Rotation, computed: Computed, *, count: int | None = None) -> Twin:
    """Evaluate a rotation that was simulated.

    Parameters
    ----------
    rig : Drum
        The rig.
    cast : Cast
        Particle, wall and contacts.
    rotation : Rotation
        Result of the run.
    computed : Computed
        How it was computed.
    count : int, optional
        Number of particles where it was stated.

    Returns
    -------
    Twin
        As `drum_twin` returns it.

    Raises
    ------
    BadInput
        If it cannot be evaluated.
    """
    from rigtwin.measure.drum import evaluate as ruler
    from rigtwin.sim import drum

    checks = drum.checks(rig, cast.particle, rotation)
    try:
        evaluation = ruler.evaluate(
            rotation.profiles[1:],  # the first profile is the bed at rest
            rotation.time[1:],
            drum_diameter=rig.diameter,
            speed=abs(rig.speed),
            bead_diameter=cast.particle.typical.diameter,
        )
    except NothingToMeasure as error:
        flows = froude_check(rig.speed, rig.diameter / 2)
        if not flows.passed:
            raise BadInput(f"speed: {flows.message}") from error
        if why := failed(checks, {"fill", "beads_enough"}):
            raise BadInput(f"{'fill' if count is None else 'count'}: {why}.") from error
        raise
    angles = tuple(doubted(one, failed(checks)) for one in evaluation.quantities)
    mixed = (rotation.mixed.quantity(rotation.turns),) if math.isfinite(rotation.mixed.index) else ()
    evaluation = replace(evaluation, quantities=(*angles, *mixed), checks=(*checks, *evaluation.checks))
    over_time = ruler.angles_over_time(rotation.profiles, rotation.time, drum_diameter=rig.diameter)
    course = {
        "count": rotation.count,
        "turns": rotation.turns,
        "steady_from_s": rotation.steady_from,
        "mixing_index": float(rotation.mixing.value[-1]),
    }
    shown = (rotation.steady,), (rotation.mixing, *over_time), lambda: drum.picture(rig, rotation)
    twin = bulk_twin("drum", rig, cast, rotation, evaluation, computed, course, *shown)
    return replace(twin, surfaces=rotation.profiles)


def need_usual_filling(rig: Drum, particle: Particle) -> None:
    """Check a drum of an unstated number of particles: a filling far beyond that of a drum on a bench is refused.

    Parameters
    ----------
    rig : Drum
        Diameter [m], speed [rad/s], depth [m] and fill.
    particle : Particle
        The particle.

    Raises
    ------
    BadInput
        As `rigtwin.sim.drum.check` and `rigtwin.compare.twins.run_cost.need_usual_number` raise it.
    """
    from rigtwin.sim import drum

    drum.check(rig, particle, count=None)
    origin = f"the filling of a drum of {rig.diameter * 1e3:.4g} mm over the volume of a particle"
    sizes = "diameter, depth and fill of the drum and the size of the particle"
    need_usual_number("drum_diameter", drum.filled(rig, particle), particle, origin, sizes)


class DrumEntry(ManyBodyEntry[DrumSettings]):
    """The rotating drum in `compare`."""

    settings = DrumSettings

    def is_photo(self, view: Path) -> bool:
        return view.suffix.lower() in PICTURES

    def known(self, experiment: Experiment) -> dict[str, Any]:
        rig = self.rig(experiment)
        return {"drum_diameter": rig.drum_diameter, "speed": rig.speed}

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [
            Stated("drum", rig.drum_diameter, 1e3, " mm"),
            Stated("turning at", rig.speed, 30 / math.pi, " rpm"),
            Stated("depth", rig.depth, 1e3, " mm"),
            Stated("count", rig.count, 1, ""),
        ]

    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[curve_overlays.Overlay]:
        return curve_overlays.mean_surface(
            measured, twins, self.rig(experiment).drum_diameter, experiment.particle.typical.diameter
        )

    def takes_count(self, experiment: Experiment) -> bool:
        rig = self.rig(experiment)
        return rig.count is None and rig.fill is None

    def count(self, experiment: Experiment, count: int | None) -> int | None:
        rig = self.rig(experiment)
        return rig.count or (count if self.takes_count(experiment) else None)

    def needs_measurement(self, experiment: Experiment) -> bool:
        return bool(experiment.repetitions) and (
            self.takes_count(experiment) or self._count_without_depth(experiment) is not None
        )

    def completed(self, experiment: Experiment, measurements: Sequence[Measurement]) -> tuple[Experiment, str]:
        """Take the fill from the film, or, where the number of particles is stated, the depth that goes with both."""
        from rigtwin.sim.run.filling import TIGHTEST

        seen = [check.value for item in measurements for check in item.checks if check.check == "fill"]
        seen = [share for share in seen if FLOWING[0] < share < FLOWING[1]]
        rig = self.rig(experiment)
        if not seen:
            return experiment, ""
        fill = fmean(seen)
        if (count := self._count_without_depth(experiment)) is not None:
            beads = count * experiment.particle.mean_volume / PACKING
            thinnest = TIGHTEST * experiment.particle.diameter  # a single layer is less dense than `PACKING`
            depth = max(beads / (fill * math.pi / 4 * rig.drum_diameter**2), thinnest)
            share = count * experiment.particle.mean_volume / (depth * fill * math.pi / 4 * rig.drum_diameter**2)
            return replace(experiment, rig=replace(rig, depth=depth)), (
                f"a fill of {fill:.3g}, for which {count} particles need a depth of {1e3 * depth:.3g} mm at a volume "
                f"fraction of {share:.2g} (state depth where it is known)"
            )
        if not self.takes_count(experiment):
            return experiment, ""
        return replace(experiment, rig=replace(rig, fill=fill)), f"a fill of {fill:.3g}"

    def _count_without_depth(self, experiment: Experiment) -> int | None:
        """The stated number of particles where depth and fill are left open, else None."""
        rig = self.rig(experiment)
        return rig.count if rig.depth is None and rig.fill is None else None

    def assumed(self, experiment: Experiment, count: int | None) -> list[str]:
        rig = self.rig(experiment)
        depth = [f"a depth of {rig.drum_diameter / 2 * 1e3:.3g} mm"] if rig.depth is None else []
        return [*depth, f"a fill of {FILL:g}"] if self.takes_count(experiment) and count is None else depth

    def check_count(self, experiment: Experiment, count: int | None) -> None:
        from rigtwin.sim import drum

        rig, particle = self.rig(experiment).rig(), experiment.particle
        if count is None:
            need_usual_filling(rig, particle)
        else:
            drum.check(rig, particle, count=count)

    def filled_twin(self, experiment: Experiment, cast: Cast, count: int | None, **run: Any) -> Twin:
        return drum_twin(self.rig(experiment).rig(), cast, count=count, **run)
