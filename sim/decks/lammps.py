"""Decks for LAMMPS with the package GRANULAR: walls are regions, contacts `granular` with explicit stiffnesses.

Normal force hertz with 4/3 E*, tangential force mindlin with 8 G*, so that no mixing rule of the code is used.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rigtwin.lab.errors import BadInput
from rigtwin.lab.rigs import GRAVITY, Hopper, Packing
from rigtwin.lab.rolling_conventions import rolling_friction
from rigtwin.sim.decks import commands
from rigtwin.sim.decks.deck import END, RECORD, Deck, rolling_stiffness
from rigtwin.sim.run.filling import SKIN

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import PairLaw
    from rigtwin.sim.engine.walls.shapes import Shape

NAME = "in.lammps"
COMMAND = f"lmp -in {NAME}"
THICK = 0.5  # [bead radii], of the plate that stands for a thin disc
# polynomial in the restitution for alpha in the damping alpha sqrt(m k) (LAMMPS manual, pair granular, damping tsuji)
TSUJI = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)


def differences(deck: Deck) -> tuple[str, ...]:
    """Return the remaining differences from rigtwin's own twin.

    Parameters
    ----------
    deck : Deck
        Deck that is written for LAMMPS.

    Returns
    -------
    tuple of str
        The differences, in words.
    """
    found = [
        "the spring of LAMMPS's rolling sds does not stiffen with the load; it equals type C's under ten weights",
        "a disc is a plate with a thickness of half a bead's radius on the side without beads",
    ]
    if isinstance(deck.rig, (Hopper, Packing)):
        found.append("cones and tubes touch only beads whose centres lie between their ends, so edges do not push")
    if (clump := deck.particle.shape) is not None:
        missed = commands.inertia_missed(clump)
        found.append(f"the moments of inertia of the clump are within {100 * missed:.2g} % of its own")
    if deck.rolling != "type C":
        found.insert(0, f"LAMMPS has no rolling resistance of {deck.rolling}; sds has the same limit of the torque")
    return tuple(found)


def converted(deck: Deck) -> dict[str, Any]:
    """Return the coefficients in LAMMPS's conventions.

    Parameters
    ----------
    deck : Deck
        Deck whose coefficients are converted.

    Returns
    -------
    dict of str to object
        The coefficients, in SI.
    """
    names = ("k_n", "restitution", "k_t", "x_gamma_t", "static_friction", "k_roll", "gamma_roll", "rolling_friction")
    among, against = _coefficients(deck)
    return {
        "particle-particle": dict(zip(names, among, strict=True)),
        "particle-wall": dict(zip(names, against, strict=True)),
        "rolling_friction_arm": "effective radius",
    }


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
    named = {NAME: _input(deck)}
    if len(scene.places):
        named["beads.data"] = commands.positions(deck, 1)
    if len(scene.places) < scene.count:
        named["pour.in"] = commands.poured(deck)
    return named


def _coefficients(deck: Deck) -> tuple[tuple[float, ...], tuple[float, ...]]:
    among, against = deck.laws
    bead = deck.particle.typical
    radius, inertia = deck.contact_radius, min(bead.moments)

    def each(law: PairLaw, effective: float, other: float, shared: float) -> tuple[float, ...]:
        spring = rolling_stiffness(deck, law, effective)
        from rigtwin.sim.engine.contact import ROLLING_DAMPING

        dashpot = 2 * ROLLING_DAMPING * math.sqrt(spring * shared)
        return (
            4 / 3 * law.effective_modulus,
            _tsuji(law.damping),
            8 * law.effective_shear,
            math.sqrt(4 * law.effective_shear / law.effective_modulus),
            law.friction,
            spring / effective**2,
            dashpot / effective**2,
            rolling_friction(law.rolling_friction, radius, other, arm="effective radius"),
        )

    return each(among, radius / 2, radius, inertia / 2), each(against, radius, math.inf, inertia)


def _tsuji(damping: float) -> float:
    """Restitution that LAMMPS converts to the dashpot of `rigtwin.sim.engine.contact`, whose law has `damping`.

    There the force is alpha sqrt(m k) v with k = 4/3 E* sqrt(R d), here damping sqrt(m S) v with S = 3/2 k.
    """
    wanted = math.sqrt(1.5) * damping
    low, high = 0.0, 1.0
    if wanted > TSUJI[0]:
        raise BadInput("restitution: the damping is stronger than LAMMPS's `damping tsuji` can be; give 0.2 or more.")
    for _ in range(60):
        middle = (low + high) / 2
        alpha = sum(factor * middle**power for power, factor in enumerate(TSUJI))
        low, high = (middle, high) if alpha > wanted else (low, middle)
    return (low + high) / 2


def _model(values: tuple[float, ...]) -> str:
    stiff, restitution, shear, dashpot, friction, roll, damp, rolls = (f"{value:.10g}" for value in values)
    rolling = f" rolling sds {roll} {damp} {rolls}" if values[-1] > 0 else ""
    return (
        f"hertz {stiff} {restitution} tangential mindlin {shear} {dashpot} {friction}{rolling} "
        "damping tsuji limit_damping"
    )


def _input(deck: Deck) -> str:
    scene = deck.scene
    among, against = _coefficients(deck)
    made = {name: _walls(deck, name, shape, _model(against)) for name, shape in scene.walls.items()}
    spins = any(hasattr(stage, "spin") for stage in scene.stages)

    def opened(wall: str) -> str:
        return "".join(f"unfix {line.split()[1]}\n" for line in made[wall].splitlines() if line.startswith("fix"))

    def turned(spin: float) -> str:
        return f"variable begun equal {spin:.10g}*{deck.time_step:.10g}*step\nvariable b0 equal ${{begun}}\n" + (
            f"variable theta equal {spin:.10g}*{deck.time_step:.10g}*step-v_b0\n"
        )

    said = "".join(f"# {words}\n" for words in deck.warnings)
    return (
        f"# {deck.rig_name} with {scene.count} beads of {deck.particle.name}, seed {deck.seed}; SI\n"
        f"# run in this folder: {COMMAND}, or: mpirun -np 2 {COMMAND}\n"
        f"# contacts in LAMMPS's conventions stand here, in rigtwin's in deck.json\n{said}"
        f"shell rm {RECORD}\nshell rm {END}\n"
        "units si\natom_style sphere\natom_modify map array\nboundary f f f\nnewton off\ncomm_modify vel yes\n"
        f"processors * * 1\n{commands.start(deck, 1)}"
        f"neighbor {SKIN * deck.particle.diameter:.10g} bin\nneigh_modify delay 0\n{_of_clumps(deck)}"
        f"pair_style granular\npair_coeff * * {_model(among)}\n"
        f"timestep {deck.time_step:.10g}\nfix weight all gravity {GRAVITY} vector 0 0 -1\n"
        + ("variable theta equal 0.0\n" if spins else "")
        + "".join(made.values())
        + f"{_moved(deck)}{commands.observed(deck)}"
        + commands.stages(deck, NAME, opened, turned)
    )


def _of_clumps(deck: Deck) -> str:
    if deck.particle.shape is None:
        return ""
    reach = 2.5 * deck.particle.diameter  # a body must fit into the ghost layer of its owner
    return f"neigh_modify exclude molecule/intra all\ncomm_modify cutoff {reach:.10g}\n"


def _moved(deck: Deck) -> str:
    if deck.particle.shape is None:
        return "fix move all nve/sphere\n"
    return commands.RIGID if len(deck.scene.places) else ""


def _walls(deck: Deck, name: str, shape: Shape, model: str) -> str:
    """Regions and fixes of one wall."""
    from rigtwin.sim.engine.walls.shapes import Cone, Cylinder, Disc

    turning = " rotate v_theta 0 0 0 0 1 0" if any(hasattr(stage, "spin") for stage in deck.scene.stages) else ""
    if isinstance(shape, Disc):
        axis, (one, other), level = _along(shape.centre, shape.normal)
        away = math.copysign(THICK * deck.particle.radius, level - deck.scene.inside["xyz".index(axis)])
        if level == deck.scene.inside["xyz".index(axis)]:
            away = -THICK * deck.particle.radius
        low, high = sorted((level, level + away))
        regions = {name: f"cylinder {axis} {one:g} {other:g} {shape.radius:.10g} {low:.10g} {high:.10g} side out"}
    elif isinstance(shape, Cylinder):
        axis, (one, other), low = _along(shape.centre, shape.axis)
        tube = f"cylinder {axis} {one:g} {other:g} {shape.radius:.10g} {low:.10g} {low + shape.height:.10g}"
        regions = {name: f"{tube} side in"} | ({f"{name}_out": f"{tube} side out"} if name == "rim" else {})
    elif isinstance(shape, Cone):
        axis, (one, other), low = _along(shape.centre, shape.axis)
        radii = f"{shape.radius:.10g} {shape.far_radius:.10g}"
        regions = {name: f"cone {axis} {one:g} {other:g} {radii} {low:.10g} {low + shape.height:.10g} side in"}
    else:
        raise BadInput(
            f"{deck.rig_name}: a LAMMPS deck has no walls like {name!r} ({type(shape).__name__.lower()}); export this "
            "rig for LIGGGHTS or Yade."
        )
    opening = "" if isinstance(shape, Disc) else " open 1 open 2"
    return "".join(
        f"region {each} {words} units box{turning}{opening}\n"
        f"fix wall_{each} all wall/gran/region granular {model} region {each}\n"
        for each, words in regions.items()
    )


def _along(
    point: tuple[float, float, float], axis: tuple[float, float, float]
) -> tuple[str, tuple[float, float], float]:
    """Axis by name, the two other coordinates, and the one along it."""
    k = max(range(3), key=lambda each: abs(axis[each]))
    if abs(axis[k]) < math.hypot(*axis) * (1 - 1e-12):
        raise BadInput("walls of LAMMPS lie along an axis; export this rig for LIGGGHTS or Yade.")
    one, other = (point[each] for each in range(3) if each != k)
    return "xyz"[k], (one, other), point[k]
