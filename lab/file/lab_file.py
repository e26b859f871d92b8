"""The lab's notebook: reads a folder with a `lab.toml` that says all the experimenter knows.

Every quantity in the file carries its unit as text ("6.2 mm"); a bare number is SI.  Names that the file does not
define are looked up in the published reference, and `Lab.borrowed` says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import copies
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.lookup import Inventory
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.file.own_particles import filling_in_words
from rigtwin.lab.file.repetitions import Views, expanded
from rigtwin.lab.file.schema import (
    Bracketed,
    CameraEntry,
    Document,
    ExperimentEntry,
    LabFile,
    Problem,
    Repaired,
    read_document,
    repaired,
    validated,
    without_consequences,
)
from rigtwin.lab.file.stated_values import stated_quantities, stated_scatter
from rigtwin.lab.file.toml_lines import Key, dotted
from rigtwin.lab.formatting import few_of
from rigtwin.lab.input_files import OUTSIDE, lies_outside
from rigtwin.lab.materials import PARAMETERS, Contact, KnownContact, Material, Pair, Particle
from rigtwin.lab.output_files import replacing
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.reference.repetition_scatter import Scatter
from rigtwin.lab.rigs import RIGS, SETTINGS, RigName, RigSettings
from rigtwin.lab.spelling import suggestion
from rigtwin.lab.tracked.table import TableOptions


@dataclass(frozen=True)
class Experiment:
    """One rig with one particle, its settings, its repetitions and what is stated as measured."""

    id: str
    rig: RigSettings
    particle: Particle
    wall: Material | None  # None in the double pendulum
    camera: Camera
    repetitions: tuple[
        tuple[Path, ...], ...
    ]  # per repetition its media or tracked CSV; several views of one bed or pile
    table: TableOptions = field(default_factory=TableOptions)
    """What is stated of tables of tracked data."""
    outside: frozenset[Path] = frozenset()
    """Files of the repetitions that lie outside the lab's folder."""
    measured: tuple[Quantity, ...] = ()
    """What lab.toml states as measured; it replaces what the repetitions give of the same quantity and method."""
    scatter: Mapping[str, Scatter] = field(default_factory=dict)
    """Scatter from repetition to repetition that lab.toml states, by quantity."""
    cameras: Mapping[Path, Camera] = field(default_factory=dict)
    """Cameras of files for which something else is stated than `camera`."""
    rejected: Mapping[Path, str] = field(default_factory=dict)
    """Files that lab.toml names but rejects, which are not in `repetitions`, and why."""
    with_rejected: tuple[Views, ...] = ()
    """`repetitions` with the rejected files in their places."""
    own_particle: bool = True
    """Whether lab.toml describes the particle; else it is taken from the published reference."""

    @property
    def particle_place(self) -> str:
        """Where the particle is described, in words."""
        name = self.particle.name
        return f"[particles.{name}]" if self.own_particle else f"{name} (taken from the reference)"

    def camera_of(self, view: Path) -> Camera:
        """Return what is stated of the camera of one file.

        Parameters
        ----------
        view : Path
            Clip or photo of a repetition.

        Returns
        -------
        Camera
            The camera.
        """
        return self.cameras.get(view, self.camera)

    @property
    def rig_name(self) -> RigName:
        """One of `rigtwin.lab.rigs.RIGS`."""
        return self.rig.name

    @property
    def contacts(self) -> tuple[tuple[str, str], ...]:
        """The pairs that touch in this experiment, for `Model.contact`: with the wall first, then with its like."""
        bead = self.particle.name
        wall = () if self.wall is None else ((bead, self.wall.name),)
        like = ((bead, bead),) if self.rig.particles_touch else ()
        return (*wall, *like)


@dataclass(frozen=True)
class Lab:
    """All that a lab.toml says."""

    title: str
    folder: Path
    materials: Mapping[str, Material]
    particles: Mapping[str, Particle]
    contacts: Mapping[Pair, KnownContact]
    experiments: tuple[Experiment, ...]
    model: Model  # the materials, particles and contacts above, without effects
    borrowed: tuple[str, ...]  # one sentence for each thing taken from the published reference
    path: Path  # the lab.toml
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    """Standard uncertainties that are stated, by key: SI, or relative."""
    stl_files: tuple[Path, ...] = ()
    """STL files that describe particles."""
    notes: tuple[str, ...] = ()
    """How near the clump of each particle with an STL file comes to it."""

    def contact(self, a: str, b: str, needs: Sequence[str] = PARAMETERS) -> Contact:
        """Return the contact of two names.

        Parameters
        ----------
        a, b : str
            Names of the two sides, in any order.
        needs : sequence of str
            Parameters that must be known.

        Returns
        -------
        Contact
            The contact.

        Raises
        ------
        TwinLacks
            If a needed parameter is not known.
        """
        return self.model.contact(a, b, needs)

    def experiment(self, name: str) -> Experiment:
        """Return an experiment.

        Parameters
        ----------
        name : str
            Id of the experiment.

        Returns
        -------
        Experiment
            The experiment.

        Raises
        ------
        KeyError
            If there is none.
        """
        return {experiment.id: experiment for experiment in self.experiments}[name]


def read_lab(folder: Path, *, allow_outside: bool = False) -> Lab:
    """Read a lab.

    Parameters
    ----------
    folder : Path
        The folder with the lab.toml, or the lab.toml itself.
    allow_outside : bool
        Whether the lab may name files outside its folder.

    Returns
    -------
    Lab
        All that the lab.toml says.

    Raises
    ------
    BadLabFile
        If something is wrong; one sentence for each fault: the file, the line, the key, what is wrong and what to
        write instead.
    """
    return lab_of(read_document(folder / "lab.toml" if folder.is_dir() else folder), allow_outside=allow_outside)


def lab_of(document: Document, *, allow_outside: bool = False) -> Lab:
    """Return the lab that a lab.toml describes, or would describe with this content.

    Parameters
    ----------
    document : Document
        The lab.toml, read.
    allow_outside : bool
        Whether the lab may name files outside its folder.

    Returns
    -------
    Lab
        All that it says.

    Raises
    ------
    BadLabFile
        As `read_lab` raises it.
    """
    path, read = document.path, repaired(document, LabFile)
    file = read.file
    stated = _stated(document)  # also where an example stands in the place of an experiment
    used = {str(entry[name]) for entry in stated for name in ("particle", "wall") if name in entry}  # some cover walls
    inventory = Inventory(file, path.parent, allow_outside=allow_outside, only=used)
    experiments = [
        _experiment(path.parent, inventory, entry, ("experiments", number), allow_outside, read)
        for number, entry in enumerate(file.experiments)
    ]
    found = (one for one in inventory.problems if not read.touches(one.key))
    problems = without_consequences([*read.problems, *found, *_repeated_ids(document, stated)])
    if not file.experiments:
        problems.append(Problem((), "has no experiments; add one under [[experiments]]."))
    if problems:
        raise document.error(problems)
    complete = tuple(experiment for experiment in experiments if experiment is not None)
    for experiment in complete:
        for a, b in experiment.contacts:
            inventory.borrow_contact(a, b)
    model = Model(inventory.materials, inventory.particles, inventory.contacts)
    return Lab(
        title=file.lab.title or path.resolve().parent.name,
        folder=path.parent,
        materials=model.materials,
        particles=model.particles,
        contacts=model.contacts,
        experiments=complete,
        model=model,
        borrowed=tuple(dict.fromkeys(inventory.borrowed)),
        path=path,
        uncertainty=file.uncertainty.model_dump(exclude_none=True),
        notes=tuple(
            filling_in_words(name, entry, path.parent)
            for name, entry in file.particles.items()
            if entry.stl is not None and name in used
        ),
        stl_files=tuple(
            path.parent / entry.stl for name, entry in file.particles.items() if entry.stl is not None and name in used
        ),
    )


class Fault(NamedTuple):
    """What is wrong with a key of an experiment, as only its media or its twin show."""

    experiment: Experiment
    key: Key
    why: str


def faulty(lab: Lab, faults: Sequence[Fault]) -> BadLabFile:
    """Return what `read_lab` would raise for faults: with the file and the lines.

    Parameters
    ----------
    lab : Lab
        Lab as it was read.
    faults : sequence of Fault
        What is wrong with keys of its experiments.

    Returns
    -------
    BadLabFile
        The error.
    """
    return read_document(lab.path).error(Problem(_whole(lab, one.experiment, one.key), one.why) for one in faults)


def camera_key(lab: Lab, experiment: Experiment, view: Path, name: str) -> Key | None:
    """Return the key that states a value of the camera for a file: the file's own, or that of all files.

    Parameters
    ----------
    lab : Lab
        Lab as it was read.
    experiment : Experiment
        One of its experiments.
    view : Path
        Clip or photo of a repetition.
    name : str
        Name of the value, such as ``"start"``.

    Returns
    -------
    Key or None
        Key within the experiment; None where the lab states no such value for the file.
    """
    root = _whole(lab, experiment, ())
    stated = [key[len(root) :] for key in read_document(lab.path).lines if key[: len(root)] == root]
    own: list[Key] = [("files", key[1], name) for key in stated if key[:1] == ("files",) and len(key) == 2]
    places = [*(key for key in own if lab.folder / str(key[1]) == view), ("camera", name)]
    return next((key for key in places if key in stated), None)


def _whole(lab: Lab, experiment: Experiment, key: Key) -> Key:
    """A key of an experiment from the root of the file."""
    return ("experiments", [one.id for one in lab.experiments].index(experiment.id), *key)


def read_cast(folder: Path, particle: str | None = None) -> Model:
    """Read materials, particles and contacts of a lab, its media unread.

    Parameters
    ----------
    folder : Path
        The folder with the lab.toml, or the lab.toml itself.
    particle : str, optional
        If the lab or the published reference has a particle of this name, others are not made.

    Returns
    -------
    Model
        Materials, particles and contacts, without effects.

    Raises
    ------
    BadLabFile
        As `read_lab` raises it.
    """
    document = read_document(folder / "lab.toml" if folder.is_dir() else folder)
    file = validated(document, LabFile)
    only = {particle} if particle in file.particles or particle in hlosta2020.NAMES else None
    inventory = Inventory(file, document.path.parent, only=only)
    if inventory.problems:
        raise document.error(inventory.problems)
    return Model(inventory.materials, inventory.particles, inventory.contacts)


def new_lab(folder: Path) -> list[Path]:
    """Start a lab folder: a commented lab.toml with example experiments, and a folder for each rig's media.

    Parameters
    ----------
    folder : Path
        The folder, made where it is missing.

    Returns
    -------
    list of Path
        The files that were written.

    Raises
    ------
    BadInput
        If there is a lab.toml already, which is not overwritten, or the folder cannot be written.
    """
    path = folder / "lab.toml"
    if path.exists():
        raise BadInput(f"{path}: is there already and is not overwritten; name another folder.")
    template = (resources.files("rigtwin.lab.file") / "template.toml").read_text(encoding="utf-8")
    try:
        for rig in RIGS:
            (folder / rig).mkdir(parents=True, exist_ok=True)
        with replacing(path) as part:
            part.write_text(template, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{folder}: cannot be made a lab folder ({error.strerror}); name another folder.") from None
    return [path]


def _experiment(
    folder: Path,
    inventory: Inventory,
    entry: ExperimentEntry,
    key: Key,
    allow_outside: bool,
    read: Repaired[LabFile],
) -> Experiment | None:
    if read.touches(key):  # an example stands in the place of all of it
        return None
    particle = inventory.particle(entry.particle, (*key, "particle"))
    covered = SETTINGS[entry.rig].wall_of_particles
    wall = None if entry.wall is None else inventory.wall(entry.wall, (*key, "wall"), of_particles=covered)
    found = []
    repetitions: list[Views] = []
    places: list[Key] = []
    for number, names in enumerate(entry.repetitions):
        place: Key = (*key, "repetitions", number)
        try:
            together = isinstance(names, Bracketed)
            ones = expanded(folder, names, together=together, photos=entry.several_views, outside=allow_outside)
        except BadInput as error:
            found.append(Problem(place, str(error)))
            continue
        repetitions += ones
        places += [place] * len(ones)
    outside = list(_outside(folder, repetitions, places))
    measured, wrong = _measured(entry, key, read)
    scatter, more_wrong = _scatter(entry, key)
    found += [
        *(Problem((*key, name), why) for name, why in entry.faults() if not read.touched_in(key)),
        *wrong,
        *more_wrong,
        *(_media_problems(entry, repetitions, places) if allow_outside or not outside else outside),
        *_camera_problems(entry.camera, entry, folder, (*key, "camera"), allow_outside),
        *_file_problems(entry, folder, repetitions, key, allow_outside),
        *_idle(entry, key),
    ]
    inventory.problems += found
    if particle is None or found or (entry.wall is not None and wall is None):
        return None
    rejected = {folder / name: file.rejected for name, file in entry.files.items() if file.rejected}
    return Experiment(
        entry.id,
        entry.settings(),
        particle,
        wall,
        entry.camera.camera(folder),
        _without(rejected, repetitions),
        entry.table,
        frozenset(view for views in repetitions for view in views if lies_outside(view, folder)),
        measured,
        scatter,
        {folder / name: file.over(entry.camera).camera(folder) for name, file in entry.files.items()},
        rejected,
        tuple(repetitions),
        entry.particle in inventory.file.particles,
    )


def _without(rejected: Mapping[Path, str], repetitions: Sequence[Views]) -> tuple[Views, ...]:
    """The repetitions without rejected files, and without those of which no view is left."""
    left = (tuple(view for view in views if view not in rejected) for views in repetitions)
    return tuple(views for views in left if views)


def _measured(entry: ExperimentEntry, key: Key, read: Repaired[LabFile]) -> tuple[tuple[Quantity, ...], list[Problem]]:
    """What is stated as measured, and what is wrong there."""
    if not entry.repetitions and not entry.measured and not read.touches((*key, "measured")):
        why = (
            'this key is missing; add repetitions = ["r01.mp4", "r02.mp4"], or state results under '
            "[experiments.measured]."
        )
        return (), [Problem((*key, "repetitions"), why)]
    found: list[Quantity] = []
    problems = []
    for name, given in entry.measured.items():
        try:
            found += stated_quantities(name, given, entry.settings())
        except BadInput as error:
            problems.append(Problem((*key, "measured", name), str(error)))
    return tuple(found), problems


def _scatter(entry: ExperimentEntry, key: Key) -> tuple[dict[str, Scatter], list[Problem]]:
    """The scatter that is stated, and what is wrong there."""
    found: dict[str, Scatter] = {}
    problems = []
    for name, given in entry.scatter.items():
        try:
            found[name] = stated_scatter(name, given, entry.settings())
        except BadInput as error:
            problems.append(Problem((*key, "scatter", name), str(error)))
    return found, problems


def _media_problems(entry: ExperimentEntry, repetitions: Sequence[Views], places: Sequence[Key]) -> list[Problem]:
    problems = []
    seen: dict[Path, Key] = {}
    for views, place in zip(repetitions, places, strict=True):
        if len(views) > 1 and not entry.several_views:
            problems.append(Problem(place, f"a {entry.rig} has one file per repetition; take it out of its brackets."))
        for view in views:
            if not _stands_there(view, folder_too=not entry.several_views):
                problems.append(Problem(place, f"there is no file {view}; put it there or correct the name."))
            elif (file := view.resolve()) in seen:
                # counted twice it would halve the variance of a mean without a second measurement
                problems.append(Problem(place, f"{view} is listed twice; take one of them out."))
            else:
                seen[file] = place
    # a copy under another name is no second measurement either
    given = {view.resolve(): view for views in repetitions for view in views}
    alike: dict[Path, list[Path]] = {}
    for original, copy in copies(seen):
        alike.setdefault(original, []).append(copy)
    for original, same in alike.items():
        hold = "hold" if len(same) > 1 else "holds"
        why = f"{few_of([str(given[copy]) for copy in same])} {hold} the same as {given[original]}; keep one of them."
        problems.append(Problem(seen[same[0]], why))
    return problems


def _stands_there(path: Path, *, folder_too: bool) -> bool:
    """Whether there is such a file, or a folder of numbered pictures, which is a clip too."""
    try:
        return path.is_file() or (folder_too and path.is_dir())
    except OSError:  # a name too long, a folder that may not be read
        return False


def _outside(folder: Path, repetitions: Sequence[Views], places: Sequence[Key]) -> Iterator[Problem]:
    for views, place in zip(repetitions, places, strict=True):
        for view in views:
            if (view.exists() or view.is_symlink() or ".." in view.parts) and lies_outside(view, folder):
                yield Problem(place, f"{view} {OUTSIDE}")


def _camera_problems(
    camera: CameraEntry, entry: ExperimentEntry, folder: Path, key: Key, allow_outside: bool
) -> list[Problem]:
    board = camera.board
    if board is not None and not allow_outside and lies_outside(folder / board.photo, folder):
        return [Problem((*key, "board"), f"{folder / board.photo} {OUTSIDE}")]
    return [Problem((*key, name), why) for name, why in camera.faults(folder, entry.rig)]


def _file_problems(
    entry: ExperimentEntry, folder: Path, repetitions: Sequence[Views], key: Key, allow_outside: bool
) -> Iterator[Problem]:
    """What is wrong with the keys of single files."""
    known = [view for views in repetitions for view in views]
    names = [str(view.relative_to(folder)) if view.is_relative_to(folder) else str(view) for view in known]
    for name, file in entry.files.items():
        place: Key = (*key, "files", name)
        if folder / name not in known:
            yield Problem(place, f"is none of the repetitions; {suggestion(name, names)}.")
        else:
            yield from _camera_problems(file.over(entry.camera), entry, folder, place, allow_outside)


def _idle(entry: ExperimentEntry, key: Key) -> Iterator[Problem]:
    """Keys that say something of media where there are none."""
    if entry.repetitions or not entry.measured:
        return
    stated: list[Key] = [("camera", name) for name in sorted(entry.camera.model_fields_set - {"frame_rate"})]
    stated += [(name,) for name in ("columns", "join") if name in entry.model_fields_set]
    for name in stated:
        yield Problem((*key, *name), "is not used, because there are no repetitions; leave it out.")


def _stated(document: Document) -> list[Mapping[str, Any]]:
    """The keys of the experiments as they are written; none where they are no tables."""
    written = document.data.get("experiments")
    return [entry if isinstance(entry, Mapping) else {} for entry in (written if isinstance(written, list) else ())]


def _repeated_ids(document: Document, stated: Sequence[Mapping[str, Any]]) -> list[Problem]:
    problems = []
    first: dict[str, int] = {}
    for number, entry in enumerate(stated):
        key: Key = ("experiments", number, "id")
        name = entry.get("id")
        if not name or not isinstance(name, str):  # which is a fault of its own
            continue
        if name in first:
            earlier = ("experiments", first[name], "id")
            problems.append(
                Problem(
                    key,
                    f"{name!r} is already the id of {dotted(earlier[:2])} on line {document.line(earlier)}; "
                    "give each experiment an id of its own.",
                )
            )
        first.setdefault(name, number)
    return problems
