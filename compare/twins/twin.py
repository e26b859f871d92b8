"""The result of a twin, and its files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.compare import result_files
from rigtwin.lab.custom_rig import CustomRig
from rigtwin.lab.materials import Contact, Particle
from rigtwin.lab.output_files import replacing
from rigtwin.lab.quantity import Evaluation, Quantity, Readable
from rigtwin.lab.records import (
    Profile,
    Series,
    Track,
    WallLoad,
    write_load,
    write_profile,
    write_profiles,
    write_series,
    write_tracks,
)
from rigtwin.lab.rigs import Rig


@dataclass(frozen=True, repr=False)
class Twin(Readable):
    """Result of the simulated counterpart of an experiment."""

    rig: str
    evaluation: Evaluation
    settings: dict[str, Any]
    """Rig, particle, contacts and numerics as simulated, in SI units."""
    tracks: tuple[Track, ...] = ()
    profiles: tuple[Profile, ...] = ()
    series: tuple[Series, ...] = ()
    surfaces: tuple[Profile, ...] = ()
    """Profiles of a moving surface, at the times of `series`."""
    loads: tuple[WallLoad, ...] = ()
    """Forces and torques of the particles on walls."""
    assumptions: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    failed: str = ""
    """Why the run shows no experiment that could be compared, with the setting to change; empty where it does."""
    set_from: dict[str, str] = field(default_factory=dict)
    """Quantities that are input of the twin: name -> ``"measured"`` or ``"stated"``."""
    seconds: float = 0.0  # [s], wall-clock time of the run
    cost: str = ""
    """Computing time of the run in words, if the rig reports it."""
    draw: Callable[[], npt.NDArray[np.uint8]] | None = None
    """Function that returns an RGB picture of the run, shape (height, width, 3)."""

    @property
    def quantities(self) -> tuple[Quantity, ...]:  # type: ignore[override]
        """The quantities of the simulated record."""
        return self.evaluation.quantities

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin simulate --json`."""
        return {
            "rig": self.rig,
            "settings": self.settings,
            "quantities": [quantity.to_json() for quantity in self.evaluation.quantities],
            "checks": [check.to_json() for check in self.evaluation.checks],
            "assumptions": list(self.assumptions),
            "warnings": [*self.warnings, *self.evaluation.warnings],
        }


def write_twin(twin: Twin, out: Path) -> dict[str, Path]:
    """Write records, quantities and picture of a twin.

    Parameters
    ----------
    twin : Twin
        Twin that has run.
    out : Path
        Folder, made where it is missing.

    Returns
    -------
    dict of str to Path
        The written files by kind.
    """
    out.mkdir(parents=True, exist_ok=True)
    files: dict[str, Path] = {}
    if twin.tracks:
        files["record"] = out / f"{twin.rig}-twin-track.csv"
        write_tracks(files["record"], twin.tracks)
    for item in twin.series:
        name = f"{twin.rig}-twin-{item.quantity}.csv"
        files[item.quantity] = out / name
        write_series(out / name, item)
    for load in twin.loads:
        files[f"load_on_{load.wall}"] = out / f"{twin.rig}-twin-load_on_{load.wall}.csv"
        write_load(files[f"load_on_{load.wall}"], load)
    for number, profile in enumerate(twin.profiles, start=1):
        name = f"{twin.rig}-twin-profile-{number}.csv"
        files[f"record_{number}"] = out / name
        write_profile(out / name, profile)
    if twin.surfaces:
        files["surfaces"] = out / f"{twin.rig}-twin-profiles-over-time.csv"
        write_profiles(files["surfaces"], twin.surfaces, twin.series[0].time)
    if twin.draw is not None:
        files["picture"] = out / f"{twin.rig}-twin.png"
        _write_picture(files["picture"], twin.draw())
    written = result_files.write_together(out, {"quantities.json": result_files.document(twin.to_json())})
    files["quantities"] = written["quantities.json"]
    return files


def _write_picture(path: Path, picture: npt.NDArray[np.uint8]) -> None:
    from PIL import Image

    with replacing(path) as part:
        Image.fromarray(picture).save(part, format="PNG", optimize=True)


def stated(**settings: Any) -> dict[str, Any]:
    """Return the settings that are not None; for the others the called function uses its defaults.

    Parameters
    ----------
    **settings : object
        Settings by name.

    Returns
    -------
    dict of str to object
        Those that are not None.
    """
    return {name: value for name, value in settings.items() if value is not None}


def settings_of(
    rig: Rig | CustomRig,
    particle: Particle,
    contacts: dict[str, Contact],
    *,
    threads: int | None = None,
    computed_by: str = "",
    **more: Any,
) -> dict[str, Any]:
    """Return the settings of a twin that has run, in SI units.

    Parameters
    ----------
    rig : Rig or CustomRig
        As simulated.
    particle : Particle
        As simulated.
    contacts : dict of str to Contact
        Contacts by the names of their sides.
    threads : int, optional
        CPU threads of the run.  Default: all.
    computed_by : str
        Another program that computed it, in place of the own device and threads.
    **more : object
        Further settings.

    Returns
    -------
    dict of str to object
        The settings.
    """
    return {
        "rig": asdict(rig),
        "particle": {**asdict(particle), "density": particle.effective_density},
        "contacts": {name: asdict(contact) for name, contact in contacts.items()},
        "engine": {"computed_by": computed_by} if computed_by else _own_engine(threads),
        **more,
    }


def _own_engine(threads: int | None) -> dict[str, Any]:
    from rigtwin.sim.engine import backend

    engine = backend.running()
    return {"device": engine.device, "threads": min(threads or engine.threads, engine.threads)}
