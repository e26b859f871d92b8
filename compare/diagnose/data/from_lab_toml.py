"""Turn the experiments of a lab.toml into a tracked lab; track files are read, media are measured first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigtwin.compare.chosen import chosen
from rigtwin.compare.diagnose.data.exclusions import release_row
from rigtwin.compare.diagnose.data.tilted_tracks import rolls, slides, tilted
from rigtwin.compare.diagnose.data.tracked_lab import (
    Bead,
    Camera,
    Condition,
    TrackedLab,
    need_repetitions,
    on_the_bench,
    other_rates,
)
from rigtwin.compare.measure_repetitions import Failure, measuring
from rigtwin.compare.result_files import others_before
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab, read_lab
from rigtwin.lab.file.option_names import naming_lab_keys
from rigtwin.lab.input_files import unquoted
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY, DropSettings, PendulumSettings, TiltSettings
from rigtwin.lab.tracked.read import read_bodies
from rigtwin.lab.tracked.table import is_table
from rigtwin.lab.tracked.upright import by_fall, by_swing

OPEN_HEIGHT, OPEN_ANGLE = 0.05, math.radians(5.0)
"""[m], [rad]: standard uncertainty of a release height or angle that is not stated but estimated from the tracks."""
GEOMETRY = {  # key under [uncertainty] -> name in a lab.json, and factor from SI to its unit there
    "drop_height": ("drop_height_uncertainty_m", 1.0),
    "plate_level": ("plate_level_uncertainty_deg", 180 / math.pi),
    "length": ("length_uncertainty_m", 1.0),
    "release_angle": ("release_angle_uncertainty_deg", 180 / math.pi),
    "tilt_rate": ("tilt_rate_uncertainty_rel", 1.0),
    "incline_angle": ("incline_angle_uncertainty_deg", 180 / math.pi),
}


def tracked_lab(
    path: Path,
    only: Sequence[str],
    out: Path,
    progress: Progress = silent,
    *,
    allow_outside: bool = False,
    workers: int | None = None,
) -> TrackedLab:
    """The experiments of a lab with one kind of rig and one moving body or two, as a tracked lab.

    What is filmed is measured first, and kept in the folder of results `out`.  Raises `BadInput`.
    """
    lab = read_lab(path, allow_outside=allow_outside)
    experiments = _chosen(lab, only)
    rig, wall = _kind(experiments[0])
    others = [one.id for one in experiments if _kind(one) != (rig, wall)]
    if others:
        raise BadInput(
            f"{lab.path}: {experiments[0].id} and {others[0]} are different rigs; a diagnosis treats one rig: name its "
            "experiments with --only ID, repeated for each."
        )
    need_repetitions(lab.path, sum(len(one.repetitions) for one in experiments))  # before measuring, which takes long
    others_before(out, "diagnosis.json", lab.folder, [one.id for one in experiments])
    measured, failed = _measured(experiments, out, workers, progress)
    unusable = [f"{name}: {one.source.name} was left out: {one.message}" for name, one in failed]
    if failed:
        fitting = [_without_files(one, [bad.source for name, bad in failed if name == one.id]) for one in experiments]
        experiments = [one for one in fitting if one.repetitions]
        if not experiments:
            raise BadInput(f"{failed[0][1].source}: {failed[0][1].message}")
        need_repetitions(lab.path, sum(len(one.repetitions) for one in experiments), failed=len(failed))
    conditions, sigmas = [], []
    for experiment in experiments:
        tracks, settings = _repetitions(experiment, measured, rig)
        tracks = [on_the_bench(rig, repetition) for repetition in tracks]
        sigmas += [track.sigma for repetition in tracks for track in repetition]
        conditions.append(_condition(experiment, tracks, rig, settings))
    stated = lab.uncertainty
    geometry = {name: stated[key] * unit for key, (name, unit) in GEOMETRY.items() if key in stated}
    if any("read_off" in one.settings for one in conditions):
        geometry["drop_height_uncertainty_m"] = OPEN_HEIGHT
        geometry["release_angle_uncertainty_deg"] = math.degrees(OPEN_ANGLE)
    for name, _ in (GEOMETRY["tilt_rate"], GEOMETRY["incline_angle"]):
        found = [one.settings[name] for one in conditions if name in one.settings]
        geometry = {name: max(found), **geometry} if found else geometry
    rates = [1 / float(np.median(np.diff(c.repetitions[0][0].time))) for c in conditions]
    sigma = np.concatenate(sigmas)
    camera = Camera(
        frame_rate=rates[0],
        noise=stated.get("tracking_noise", float(np.median(sigma[sigma > 0])) if (sigma > 0).any() else math.nan),
        scale_rel=stated.get("scale", Camera.scale_rel),
        clock_rel=stated.get("frame_rate", Camera.clock_rel),
        roll=stated.get("camera_roll", Camera.roll),
    )
    about = {
        name: {"density_kg_m3": m.density, "youngs_modulus_Pa": m.youngs_modulus, "poissons_ratio": m.poisson_ratio}
        for name, m in lab.materials.items()
    }
    odd = other_rates(conditions, [one.camera.frame_rate for one in experiments])
    unasked = [] if only else not_diagnosed(lab, experiments)
    return TrackedLab(
        lab.title, rig, GRAVITY, camera, geometry, tuple(conditions), lab.folder, {"walls": about},
        (*odd, *unusable, *unasked),
    )  # fmt: skip


def not_diagnosed(lab: Lab, chosen: Sequence[Experiment]) -> list[str]:
    """One sentence for each experiment of a lab that is not among the `chosen` ones."""
    there = {one.id for one in chosen}
    return [
        f"{one.id}: a {one.rig_name} is not diagnosed together with {chosen[0].id}; ask for it with --only {one.id}"
        for one in lab.experiments
        if one.id not in there
    ]


def _chosen(lab: Lab, only: Sequence[str]) -> list[Experiment]:
    asked = [one for one in chosen(lab, only) if only or _kind(one)[0]]
    if not asked:
        raise BadInput(f"{lab.path}: holds no drop, pendulum or tilt; a diagnosis of a lab.toml supports only these.")
    for one in asked:
        if not _kind(one)[0]:
            raise BadInput(f"{lab.path}: {one.id}: a diagnosis of a {one.rig_name} needs a folder with a lab.json.")
    filmed = [one for one in asked if one.repetitions]
    if not filmed or (only and len(filmed) < len(asked)):
        still = next(one for one in asked if not one.repetitions)
        raise BadInput(
            f"{lab.path}: {still.id} states results only, under [experiments.measured]; a diagnosis needs repetitions, "
            "films or tracked data of the motion."
        )
    return filmed


def _kind(experiment: Experiment) -> tuple[str, bool]:
    """The rig's name in a lab.json, empty if it has none, and whether a pendulum hits a wall."""
    if isinstance(experiment.rig, DropSettings):
        return "drop", False
    if isinstance(experiment.rig, PendulumSettings):
        return ("double", False) if experiment.rig.variant == "double" else ("pendulum", True)
    if isinstance(experiment.rig, TiltSettings):
        return experiment.rig.variant, False
    return "", False


def _measured(
    experiments: Sequence[Experiment], out: Path, workers: int | None, progress: Progress
) -> tuple[dict[tuple[str, Path], Measurement], list[tuple[str, Failure]]]:
    """The measurements of what is not read from a table, by experiment and first file, and failures by experiment."""
    filmed = [
        _without_files(one, [views[0] for views in one.repetitions if _is_tracked_table(one, views)])
        for one in experiments
    ]
    if not any(one.repetitions for one in filmed):
        return {}, []
    with measuring([one for one in filmed if one.repetitions], out, workers) as pending:
        found = pending.results(progress)
    return (
        {(name, item.source): item for name, one in found.items() for item in one.measurements},
        [(name, failure) for name, one in found.items() for failure in one.failures],
    )


def _without_files(experiment: Experiment, first: Sequence[Path]) -> Experiment:
    """The experiment without the repetitions that begin with one of these files."""
    return replace(experiment, repetitions=tuple(v for v in experiment.repetitions if v[0] not in first))


def _is_tracked_table(experiment: Experiment, views: Sequence[Path]) -> bool:
    """Whether the positions of a repetition are read as they stand."""
    return not isinstance(experiment.rig, TiltSettings) and is_table(views[0])


def _repetitions(
    experiment: Experiment, measured: Mapping[tuple[str, Path], Measurement], rig: str
) -> tuple[list[tuple[Track, ...]], dict[str, float]]:
    """The repetitions in the axes of a lab.json, and the settings that their measurement gives."""
    every = [(views, measured.get((experiment.id, views[0]))) for views in experiment.repetitions]
    if not isinstance(experiment.rig, TiltSettings):
        return [_tracks(experiment, views, found, rig) for views, found in every], {}
    runs = [tilted(experiment, found) for _, found in every if found is not None]
    return (slides if rig == "slide" else rolls)(runs, experiment.particle.diameter / 2)


def _tracks(experiment: Experiment, views: Sequence[Path], measured: Measurement | None, rig: str) -> tuple[Track, ...]:
    """One repetition in the axes of a lab.json."""
    if measured is None:
        camera, direction = experiment.camera_of(views[0]), by_fall if rig == "drop" else by_swing
        with (
            naming_lab_keys(experiment.rig_name, experiment.particle_place),
            unquoted(views[0], outside=views[0] in experiment.outside),
        ):
            found = read_bodies(
                views[0],
                experiment.table,
                scale=camera.given_scale,
                frame_rate=camera.frame_rate,
                direction=direction,
                only_height=rig == "drop",
            ).in_metres(views[0])
        return _upon_the_plate(found, views[0], experiment) if rig == "drop" else found
    radius = experiment.particle.diameter / 2
    # the origin of a measured drop is the bead's centre at first contact, that of pendulums the last bead at rest
    shift = np.array([0.0, radius])
    if isinstance(experiment.rig, PendulumSettings):
        shift = np.array([radius if rig == "double" else 0.0, -experiment.rig.length])
    return tuple(_moved(track, shift) for track in measured.tracks)


def _upon_the_plate(tracks: tuple[Track, ...], path: Path, experiment: Experiment) -> tuple[Track, ...]:
    """Tracks with the origin on the plate, from tracks with the origin there or at the bead's centre in contact."""
    radius = experiment.particle.diameter / 2
    lowest = float(tracks[0].position[:, 1].min())
    if abs(lowest - radius) < 0.6 * radius:
        return tracks
    if abs(lowest) < 0.6 * radius:
        return tuple(_moved(track, np.array([0.0, radius])) for track in tracks)
    raise BadInput(
        f"{path}: the lowest position is y = {1e3 * lowest:.1f} mm; y must be the height of the bead's centre above "
        f"the plate ({1e3 * radius:.1f} mm at contact), or zero at contact."
    )


def _moved(track: Track, shift: Array) -> Track:
    return replace(track, position=track.position + shift)


def _condition(
    experiment: Experiment, tracks: Sequence[tuple[Track, ...]], rig: str, found: Mapping[str, float]
) -> Condition:
    """The condition of an experiment; `found` are the settings that its measurement gave."""
    particle = experiment.particle
    mass = particle.effective_density * math.pi / 6 * particle.diameter**3
    solid = particle.material
    about = {
        "material": solid.name, "density_kg_m3": solid.density, "youngs_modulus_Pa": solid.youngs_modulus,
        "poissons_ratio": solid.poisson_ratio,
    }  # fmt: skip
    bead = Bead(particle.name, particle.diameter, mass, about)
    starts = np.array([repetition[0].position[:5].mean(axis=0) for repetition in tracks])
    settings = dict(found)
    stated: float | None = None
    if isinstance(experiment.rig, DropSettings):
        stated = experiment.rig.drop_height
        radius = particle.diameter / 2
        rows = [release_row(track, radius, GRAVITY) for (track,) in tracks]
        released = [track.position[max(k - 5, 0) : k + 1, 1].mean() for (track,), k in zip(tracks, rows, strict=True)]
        read_off = float(np.median(released)) - radius
        settings["drop_height_m"] = read_off if stated is None else stated
    elif isinstance(experiment.rig, PendulumSettings):
        stated = experiment.rig.release_angle
        side = -particle.diameter / 2 if rig == "double" else 0.0
        read_off = float(np.median(np.abs(np.arctan2(starts[:, 0] - side, -starts[:, 1]))))
        settings["length_m"] = experiment.rig.length
        settings["release_angle_deg"] = math.degrees(read_off if stated is None else stated)
    if stated is None and not found:
        settings["read_off"] = 1.0
    wall = experiment.wall.name if experiment.wall is not None else ""
    names = tuple(str(views[0]) for views in experiment.repetitions)
    return Condition(experiment.id, bead, wall, settings, tuple(tracks), names)
