"""A deck: the files with which another code computes a twin, and their description."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.custom_rig import CustomRig, StlWall
from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import DAMAGED
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile
from rigtwin.lab.units import positive
from rigtwin.lab.version import __version__
from rigtwin.sim.decks.scene import BulkRig, Scene, mesh_name, scene_of
from rigtwin.sim.engine.time_step import USUAL, time_step

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import PairLaw, Rolling
    from rigtwin.sim.engine.walls.shapes import Shape

Code = Literal["liggghts", "lammps", "yade"]
CODES = get_args(Code)
TITLES: dict[Code, str] = {"liggghts": "LIGGGHTS", "lammps": "LAMMPS", "yade": "Yade"}
RIGS: dict[str, type[BulkRig]] = {"packing": Packing, "pile": Pile, "drum": Drum, "hopper": Hopper, "custom": CustomRig}
DESCRIPTION, RECORD, END = "deck.json", "record.dump", "end.dump"
SECTORS = 96  # of a round wall of triangles: at 50 mm radius they deviate from it by 0.03 mm
SLENDER = 200  # [1], longest over shortest side of a triangle; LIGGGHTS 3.8 stops at about 225 (0.256 degrees)
LOAD = 10  # [weights of a bead], at which a constant rolling stiffness equals type C's, as deep in a small bed


@dataclass(frozen=True)
class Deck:
    """A twin for another code, in rigtwin's conventions and SI units."""

    code: Code
    rig: BulkRig
    particle: Particle
    wall: Material
    contact: Contact  # among the beads
    wall_contact: Contact
    count: int | None  # None: a drum that is filled as its rig says
    seed: int
    rolling: Rolling = "type C"
    stiffness_factor: float = 1e-3
    time_step_fraction: float = USUAL
    forced: bool = False
    options: Mapping[str, float] | None = None  # of the run, as `rigtwin.sim.<rig>.run` takes them
    surfaces: Mapping[str, tuple[Material, Contact]] | None = None
    """Custom rig: material and contact of walls that are of another material than `wall`."""
    notes: tuple[str, ...] = ()
    """Remarks on the rig."""

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise BadInput(f"code: {self.code!r} is unknown; use {', '.join(map(repr, CODES))}.")
        if isinstance(self.rig, CustomRig) and self.code != "liggghts":
            raise BadInput(
                f"export {self.code}: a deck for {TITLES[self.code]} holds no walls from STL files; export the rig for "
                "LIGGGHTS."
            )
        if self.particle.shape is not None:
            self._check_clump()
        if isinstance(self.rig, Pile) and self.rig.variant == "pouring" and self.code != "liggghts":
            raise BadInput(
                f"method: a deck for {TITLES[self.code]} holds no tube that is lifted; export a pile by piling or "
                "emptying, or for LIGGGHTS."
            )
        positive(stiffness_factor=self.stiffness_factor)
        if self.stiffness_factor > 1:
            raise BadInput(f"stiffness_factor: {self.stiffness_factor:g} is above 1; give at most 1.")

    def _check_clump(self) -> None:
        if self.code != "lammps":
            raise BadInput(
                f"{self.particle.name}: is a clump of spheres, and a deck for {TITLES[self.code]} holds single spheres "
                "only; export a packing or a drum for LAMMPS."
            )
        if not isinstance(self.rig, (Packing, Drum)):
            raise BadInput(
                f"{self.particle.name}: is a clump of spheres, and LAMMPS ends where one leaves the rig; export a "
                "packing or a drum."
            )

    @property
    def contact_radius(self) -> float:
        """Radius [m] that the contact parameters are computed for."""
        radii = self.particle.typical.radii
        return sum(radii) / len(radii)

    @cached_property
    def soft(self) -> Particle:
        """The bead with the moduli that are simulated."""
        return replace(self.particle, material=self.particle.material.softened(self.stiffness_factor))

    @cached_property
    def soft_wall(self) -> Material:
        """The material of the walls with the moduli that are simulated."""
        return self.wall.softened(self.stiffness_factor)

    @property
    def time_step(self) -> float:
        """Time step [s]."""
        lowest = min([self._restitution, *(one.restitution for _, one in (self.surfaces or {}).values())])
        return time_step([self.soft], self.time_step_fraction, forced=self.forced, restitution=lowest)[0]

    @property
    def _restitution(self) -> float:
        return 1.0 if not self.own_walls else min(self.contact.restitution, self.wall_contact.restitution)

    @cached_property
    def scene(self) -> Scene:
        """Walls, start positions and stages."""
        from rigtwin.sim.engine.bulk.bulk import STEP_IN_RADII

        fastest = STEP_IN_RADII * self.particle.smallest_radius / self.time_step
        options = dict(self.options or {})
        return scene_of(self.rig, self.particle, count=self.count, seed=self.seed, fastest=fastest, **options)

    @property
    def own_walls(self) -> Mapping[str, StlWall]:
        """Walls of a custom rig by name."""
        return self.rig.walls if isinstance(self.rig, CustomRig) else {}

    @property
    def laws(self) -> tuple[PairLaw, PairLaw]:
        """Constants of the contact law among the beads, and at the walls."""
        from rigtwin.sim.engine.contact import pair_law

        bead = self.soft.material
        return pair_law(bead, bead, self.contact), pair_law(bead, self.soft_wall, self.wall_contact)

    def steps(self, duration: float) -> int:
        """Return the number of time steps in a duration.

        Parameters
        ----------
        duration : float
            Duration [s].

        Returns
        -------
        int
            At least one.
        """
        return max(1, round(duration / self.time_step))

    @property
    def rig_name(self) -> str:
        """One of `RIGS`."""
        return next(name for name, kind in RIGS.items() if isinstance(self.rig, kind))

    def _rig_of_files(self) -> BulkRig:
        """The rig with the STL files of the deck, which are in metres."""
        rig = self.scene.rig
        if not isinstance(rig, CustomRig):
            return rig
        files = {name: replace(wall, stl=f"{mesh_name(name)}.stl", unit=1.0) for name, wall in rig.walls.items()}
        return replace(rig, walls=files)

    @property
    def command(self) -> str:
        """Command line that runs the deck in its folder."""
        return str(_writer(self.code).COMMAND)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the deck does otherwise than rigtwin's own twin, and warnings about its settings."""
        step = time_step([self.soft], self.time_step_fraction, forced=self.forced)[1]
        return (*self.notes, *self.scene.warnings, *step, *_writer(self.code).differences(self), *self._of_sizes())

    def _of_sizes(self) -> tuple[str, ...]:
        if self.particle.sizes is None:
            return ()
        return (
            "rolling resistance is exact between beads of the same size: between others the code takes an effective "
            "radius, and springs and dashpots of rolling are those of the median size by mass",
        )

    def files(self) -> dict[str, str]:
        """Content of the deck's files by name, the description included."""
        named: dict[str, str] = _writer(self.code).files(self)
        return {DESCRIPTION: json.dumps(self.to_json(), indent=1) + "\n", **named}

    def to_json(self) -> dict[str, Any]:
        """Content of deck.json, from which `from_json` builds the deck again."""
        return {
            "rigtwin": __version__,
            "code": self.code,
            "command": self.command,
            "rig": {"name": self.rig_name, **asdict(self._rig_of_files())},
            "particle": {**asdict(self.particle), "density": self.particle.effective_density},
            "wall": asdict(self.wall),
            "contacts": {"particle-particle": asdict(self.contact), "particle-wall": asdict(self.wall_contact)},
            "conventions": "rolling friction: torque of at most mu_r Fn R on each bead; SI units, angles in radians",
            "count": self.scene.count,
            "seed": self.seed,
            "rolling": self.rolling,
            "stiffness_factor": self.stiffness_factor,
            "time_step_fraction": self.time_step_fraction,
            "forced": self.forced,
            "time_step_s": self.time_step,
            "options": dict(self.options or {}),
            "surfaces": {name: [asdict(one) for one in pair] for name, pair in (self.surfaces or {}).items()},
            "notes": list(self.notes),
            "dump": {"record": RECORD if self.scene.records else None, "end": END, "columns": "id x y z vx vy vz"},
            "in_the_code": _writer(self.code).converted(self),
            "warnings": list(self.warnings),
        }


def read_deck(folder: Path) -> Deck:
    """Read the deck in a folder that `rigtwin export` wrote.

    Parameters
    ----------
    folder : Path
        Folder of the deck.

    Returns
    -------
    Deck
        The deck.

    Raises
    ------
    BadInput
        If there is none, or it is damaged.
    """
    from pydantic import TypeAdapter, ValidationError

    path = folder / DESCRIPTION
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
        keys = {name: value for name, value in dict(said["rig"]).items() if name != "name"}
        rig = TypeAdapter(RIGS[said["rig"]["name"]]).validate_python(keys)
        if isinstance(rig, CustomRig):
            here = {name: replace(wall, stl=str(folder / Path(wall.stl).name)) for name, wall in rig.walls.items()}
            rig = replace(rig, walls=here)
        bead = {name: value for name, value in dict(said["particle"]).items() if name != "smallest"}
        surfaces = dict(said.get("surfaces", {}))
        whole = {name: said[name] for name in ("count", "seed") if name in said}
        said |= TypeAdapter(dict[str, int | None]).validate_python(whole)
        return Deck(
            code=said["code"],
            rig=rig,
            particle=TypeAdapter(Particle).validate_python(bead),
            wall=Material(**said["wall"]),
            contact=Contact(**said["contacts"]["particle-particle"]),
            wall_contact=Contact(**said["contacts"]["particle-wall"]),
            surfaces={name: (Material(**a), Contact(**b)) for name, (a, b) in surfaces.items()} or None,
            notes=tuple(said.get("notes", ())),
            **{each.name: said[each.name] for each in fields(Deck) if each.name in said and each.name not in _APART},
        )
    except FileNotFoundError:
        raise BadInput(f"{folder}: there is no {DESCRIPTION}; name a folder that `rigtwin export` wrote.") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise BadInput(
            f"{path}: is damaged ({where}: {first['msg'][:1].lower()}{first['msg'][1:]}); export the deck again."
        ) from error
    except DAMAGED as error:
        raise BadInput(f"{path}: is damaged ({type(error).__name__}: {error}); export the deck again.") from error


_APART = ("code", "rig", "particle", "wall", "surfaces", "notes")


def rolling_stiffness(deck: Deck, law: PairLaw, radius: float) -> float:
    """Return the stiffness S_t R^2 of type C's rolling spring under `LOAD`.

    Parameters
    ----------
    deck : Deck
        Deck whose particle and contact radius are used.
    law : PairLaw
        Constants of the contact.
    radius : float
        Effective radius [m].

    Returns
    -------
    float
        Stiffness [N m/rad].
    """
    from rigtwin.lab.rigs import GRAVITY

    bead = deck.particle.typical
    force = LOAD * bead.mass * GRAVITY
    overlap = (force / (4 / 3 * law.effective_modulus * math.sqrt(radius))) ** (2 / 3)
    return 8 * law.effective_shear * math.sqrt(radius * overlap) * deck.contact_radius**2


def triangles(shape: Shape) -> Array:
    """Return the triangles of a wall.

    A circle becomes a polygon of equal area.  A disc is cut into strips and not into sectors: a bead on its middle
    would touch all of these at once.  A slender tube is cut into rings.

    Parameters
    ----------
    shape : Shape
        Shape of the wall.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Corners of the triangles [m].
    """
    from rigtwin.sim.engine.walls import elements

    rows = shape.rows
    if rows[0, elements.KIND] == elements.TRIANGLE:
        return np.asarray(rows[:, elements.POINT :].reshape(-1, 3, 3))
    point, axis = rows[0, elements.POINT : elements.AXIS], rows[0, elements.AXIS : elements.LOW_RADIUS]
    radius, far_radius, height = rows[0, elements.LOW_RADIUS :]
    one = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    one /= np.linalg.norm(one)
    other = np.cross(axis, one)
    angle = np.arange(SECTORS)[:, None] * 2 * math.pi / SECTORS
    circle = math.sqrt(2 * math.pi / SECTORS / math.sin(2 * math.pi / SECTORS)) * (
        np.cos(angle) * one + np.sin(angle) * other
    )
    if height == 0 and radius == 0:
        rim = point + far_radius * circle
        order = [k // 2 if k % 2 == 0 else SECTORS - 1 - k // 2 for k in range(SECTORS)]
        return np.stack([rim[order[:-2]], rim[order[1:-1]], rim[order[2:]]], axis=1)
    side = 2 * math.pi / SECTORS * min(radius, far_radius)
    rings = max(1, math.ceil(abs(height) / (SLENDER * side))) if side else 1
    share = np.linspace(0, 1, rings + 1)[:, None, None]
    levels = point + share * height * axis + (radius + share * (far_radius - radius)) * circle
    low, high = levels[:-1].reshape(-1, 3), levels[1:].reshape(-1, 3)
    low_next, high_next = (np.roll(levels, -1, axis=1)[part].reshape(-1, 3) for part in (slice(-1), slice(1, None)))
    return np.concatenate([np.stack([low, low_next, high], 1), np.stack([low_next, high_next, high], 1)])


def _writer(code: Code) -> Any:
    """Module that writes the files of a code."""
    return import_module(f"rigtwin.sim.decks.{code}")
