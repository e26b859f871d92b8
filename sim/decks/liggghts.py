"""Decks for LIGGGHTS 3.8: walls are meshes (STL), contacts Hertz with tangential history."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from rigtwin.lab.custom_rig import StlWall
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.decks import commands
from rigtwin.sim.decks.card import DIFFERS, ROLLING, SOFT, Export, export
from rigtwin.sim.decks.card import HARD as STIFFEST
from rigtwin.sim.decks.deck import END, RECORD, Deck, triangles
from rigtwin.sim.decks.scene import Lift, Move, Pour, mesh_name
from rigtwin.sim.run.filling import SKIN

NAME = "in.liggghts"
COMMAND = f"liggghts -in {NAME}"


def differences(deck: Deck) -> tuple[str, ...]:
    """Return the remaining differences from rigtwin's own twin.

    Parameters
    ----------
    deck : Deck
        Deck that is written for LIGGGHTS.

    Returns
    -------
    tuple of str
        The differences, in words.
    """
    found = [DIFFERS[ROLLING[deck.rolling]]]
    if not deck.own_walls:
        found.append("round walls are polygons of equal area")
    removed = any(wall.removed is not None for wall in deck.own_walls.values())
    if removed or any(name in deck.scene.walls for name in ("lid", "slide", "tube")):
        found.append("contacts with walls lose their history when a wall is removed")
    return tuple(found)


def converted(deck: Deck) -> dict[str, Any]:
    """Return the coefficients in LIGGGHTS's conventions.

    Parameters
    ----------
    deck : Deck
        Deck whose coefficients are converted.

    Returns
    -------
    dict of str to object
        The coefficients, in SI.
    """
    made = _card(deck).to_json()
    return {"contacts": made["contacts"], "rolling_friction_arm": made["rolling_friction_arm"]}


def files(deck: Deck) -> dict[str, str]:
    """Return the input files.

    Parameters
    ----------
    deck : Deck
        Deck that the files describe.

    Returns
    -------
    dict of str to str
        Contents by name.
    """
    scene = deck.scene
    named = {"contacts.in": _card(deck).text, NAME: _input(deck)}
    named |= {f"{name}.stl": _stl(name, triangles(shape)) for name, shape in scene.walls.items()}
    if len(scene.places):
        named["beads.data"] = commands.positions(deck, _count(_types(deck)))
    if any(isinstance(stage, Pour) for stage in scene.stages):
        named["pour.in"] = commands.poured(deck)
    return named


def _card(deck: Deck) -> Export:
    others = tuple(_card_of(deck, *pair) for pair in dict.fromkeys((deck.surfaces or {}).values()))
    return replace(_card_of(deck, deck.wall, deck.wall_contact), others=others, time_step=deck.time_step)


def _card_of(deck: Deck, wall: Material, at_wall: Contact) -> Export:
    return export(
        "liggghts", deck.particle, wall, deck.contact, at_wall, rolling=deck.rolling,
        stiffness_factor=deck.stiffness_factor, time_step_fraction=deck.time_step_fraction, forced=deck.forced,
    )  # fmt: skip


def _input(deck: Deck) -> str:
    scene = deck.scene
    soft_walls = (wall.softened(deck.stiffness_factor) for wall, _ in (deck.surfaces or {}).values())
    moduli = [one.youngs_modulus for one in (deck.soft.material, deck.soft_wall, *soft_walls)]
    confirmed = "soft_particles yes\n" if min(moduli) < SOFT else ""
    confirmed += "hard_particles yes\n" if max(moduli) > STIFFEST else ""
    types = _types(deck)
    meshes = "".join(
        f"fix {name} all mesh/surface file {name}.stl type {types.get(name, 2)}{_belt(deck, name)}\n"
        for name in scene.walls
    )
    gone: list[str] = []

    def opened(wall: str) -> str:
        gone.append(wall)
        left = [name for name in scene.walls if name not in gone]
        moves = any(isinstance(one, Lift) and one.wall == wall for one in scene.stages)
        still = f"unfix lift_{wall}\n" if moves else moved(Move(wall, moving[wall], False)) if wall in moving else ""
        return f"{still}unfix walls\nunfix {wall}\n{_walls(deck, left) if left else ''}"

    moving: dict[str, StlWall] = {}

    def moved(move: Move) -> str:
        if move.wall in gone or move.motion.belt:
            return ""
        motions = _motions(move.motion)
        if move.begins:
            moving[move.wall] = move.motion
            return "".join(
                f"fix move{k}_{move.wall} all move/mesh mesh {move.wall} {one}\n" for k, one in enumerate(motions)
            )
        if moving.pop(move.wall, None) is None:
            return ""
        return "".join(f"unfix move{k}_{move.wall}\n" for k in reversed(range(len(motions))))

    def lifted(wall: str, speed: float) -> str:
        return f"fix lift_{wall} all move/mesh mesh {wall} linear 0. 0. {speed:.10g}\n"

    def turned(spin: float) -> str:
        sense = math.copysign(1.0, spin)
        return "".join(
            f"fix turn_{name} all move/mesh mesh {name} rotate origin 0. 0. 0. axis 0. {sense:.1f} 0. "
            f"period {2 * math.pi / abs(spin):.10g}\n"
            for name in scene.walls
        )

    said = "".join(f"# {words}\n" for words in deck.warnings)
    return (
        f"# {deck.rig_name} with {scene.count} beads of {deck.particle.name}, seed {deck.seed}; SI\n"
        f"# run in this folder: {COMMAND}, or: mpirun -np 2 {COMMAND}\n"
        f"# contacts in LIGGGHTS's conventions: contacts.in; in rigtwin's: deck.json\n{said}"
        f"shell rm {RECORD}\nshell rm {END}\n{confirmed}"
        "atom_style granular\natom_modify map array\nboundary f f f\nnewton off\ncommunicate single vel yes\n"
        f"units si\nprocessors * * 1\n{commands.start(deck, _count(types))}"
        f"neighbor {SKIN * deck.particle.diameter:.10g} bin\nneigh_modify delay 0\n"
        f"include contacts.in\nfix weight all gravity {GRAVITY} vector 0 0 -1\n"
        f"{meshes}{_walls(deck, list(scene.walls))}"
        f"fix move all nve/sphere\n{commands.observed(deck)}"
        f"{commands.stages(deck, NAME, opened, turned, lifted, moved)}"
    )


def _motions(wall: StlWall) -> list[str]:
    """The motion of a wall in the order in which LIGGGHTS superposes them: the axis moves with the others."""
    found = []
    if any(wall.velocity):
        found.append(f"linear {commands.three(wall.velocity)}")
    if wall.vibrates:
        amplitude = commands.three(wall.vibration_amplitude)
        found.append(f"wiggle amplitude {amplitude} period {1 / wall.vibration_frequency:.10g}")
    if wall.rotation_speed:
        found.append(
            f"rotate origin {commands.three(wall.rotation_point)} axis {commands.three(wall.rotation_axis)} "
            f"period {2 * math.pi / wall.rotation_speed:.10g}"
        )
    return found


def _belt(deck: Deck, name: str) -> str:
    """Velocity of the surface of a belt, whose mesh stays."""
    belts = {mesh_name(own): wall for own, wall in deck.own_walls.items() if wall.belt and wall.moves}
    if name not in belts:
        return ""
    wall = belts[name]
    if wall.start or wall.stop is not None or wall.vibration_frequency:
        raise BadInput(
            f"walls.{name.removeprefix('wall_')}: a belt in a LIGGGHTS deck moves all the time and does not vibrate; "
            "leave start, stop and the vibration out."
        )
    said = f" surface_vel {commands.three(wall.velocity)}" if any(wall.velocity) else ""
    if wall.rotation_speed:
        about = f"origin {commands.three(wall.rotation_point)} axis {commands.three(wall.rotation_axis)}"
        said += f" surface_ang_vel {about} omega {wall.rotation_speed:.10g}"
    return said


def _types(deck: Deck) -> dict[str, int]:
    """Type of the walls that are of another material than the others, by name; those have type 2."""
    made_of = deck.surfaces or {}
    kinds = list(dict.fromkeys(made_of.values()))
    return {mesh_name(name): 3 + kinds.index(pair) for name, pair in made_of.items()}


def _count(types: dict[str, int]) -> int:
    return max(types.values(), default=2)


def _walls(deck: Deck, names: list[str]) -> str:
    model = f"model hertz tangential history rolling_friction {ROLLING[deck.rolling]}"
    return f"fix walls all wall/gran {model} mesh n_meshes {len(names)} meshes {' '.join(names)}\n"


def _stl(name: str, corners: np.ndarray[Any, Any]) -> str:
    lines = [f"solid {name}"]
    for triangle in corners:
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        x, y, z = normal / np.linalg.norm(normal)
        lines += [f"facet normal {x:.9g} {y:.9g} {z:.9g}", "outer loop"]
        lines += [f"vertex {a:.9g} {b:.9g} {c:.9g}" for a, b, c in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, f"endsolid {name}", ""])
