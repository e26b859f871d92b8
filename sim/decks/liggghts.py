"""Decks for LIGGGHTS 3.8: walls are meshes (STL), contacts Hertz with tangential history."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.decks import commands
from rigtwin.sim.decks.card import DIFFERS, ROLLING, SOFT, Export, export
from rigtwin.sim.decks.card import HARD as STIFFEST
from rigtwin.sim.decks.deck import END, RECORD, Deck, triangles
from rigtwin.sim.decks.scene import Lift

NAME = "in.liggghts"
COMMAND = f"liggghts -in {NAME}"


def differences(deck: Deck) -> tuple[str, ...]:
    """Remaining differences from rigtwin's own twin."""
    found = [DIFFERS[ROLLING[deck.rolling]], "round walls are polygons of equal area"]
    if any(name in deck.scene.walls for name in ("lid", "slide", "tube")):
        found.append("contacts with walls lose their history when a wall is removed")
    return tuple(found)


def converted(deck: Deck) -> dict[str, Any]:
    """Coefficients in LIGGGHTS's conventions."""
    made = _card(deck).to_json()
    return {"contacts": made["contacts"], "rolling_friction_arm": made["rolling_friction_arm"]}


def files(deck: Deck) -> dict[str, str]:
    """Input files by name."""
    scene = deck.scene
    named = {"contacts.in": _card(deck).text, NAME: _input(deck)}
    named |= {f"{name}.stl": _stl(name, triangles(shape)) for name, shape in scene.walls.items()}
    if len(scene.places):
        named["beads.data"] = commands.positions(deck, 2)
    if len(scene.places) < scene.count:
        named["pour.in"] = commands.poured(deck)
    return named


def _card(deck: Deck) -> Export:
    return export(
        "liggghts", deck.particle, deck.wall, deck.contact, deck.wall_contact, rolling=deck.rolling,
        stiffness_factor=deck.stiffness_factor, time_step_fraction=deck.time_step_fraction, forced=deck.forced,
    )  # fmt: skip


def _input(deck: Deck) -> str:
    scene = deck.scene
    moduli = deck.soft.material.youngs_modulus, deck.soft_wall.youngs_modulus
    confirmed = "soft_particles yes\n" if min(moduli) < SOFT else ""
    confirmed += "hard_particles yes\n" if max(moduli) > STIFFEST else ""
    meshes = "".join(f"fix {name} all mesh/surface file {name}.stl type 2\n" for name in scene.walls)

    def opened(wall: str) -> str:
        left = [name for name in scene.walls if name != wall]
        moves = any(isinstance(one, Lift) and one.wall == wall for one in scene.stages)
        still = f"unfix lift_{wall}\n" if moves else ""
        return f"{still}unfix walls\nunfix {wall}\n{_walls(deck, left)}"

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
        f"units si\nprocessors * * 1\n{commands.start(deck, 2)}"
        f"neighbor {commands.SKIN * deck.particle.diameter:.10g} bin\nneigh_modify delay 0\n"
        f"include contacts.in\nfix weight all gravity {GRAVITY} vector 0 0 -1\n"
        f"{meshes}{_walls(deck, list(scene.walls))}"
        f"fix move all nve/sphere\n{commands.observed(deck)}"
        f"{commands.stages(deck, NAME, opened, turned, lifted)}"
    )


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
