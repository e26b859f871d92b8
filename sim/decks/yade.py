"""Decks for Yade: walls are facets, contacts MindlinPhys with bending moments."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.decks.commands import diameters
from rigtwin.sim.decks.deck import END, RECORD, Deck, rolling_stiffness, triangles
from rigtwin.sim.decks.scene import Pour
from rigtwin.sim.run.filling import LOOK

NAME, NUMBERS = "deck.py", "yade.json"
COMMAND = f"yade -n -x {NAME}"
WALL_ROLLING_EVERY = 10  # [steps], after which new contacts with walls have their own limit of rolling


def differences(deck: Deck) -> tuple[str, ...]:
    """Return the remaining differences from rigtwin's own twin.

    Parameters
    ----------
    deck : Deck
        Deck that is written for Yade.

    Returns
    -------
    tuple of str
        The differences, in words.
    """
    found = [
        "the rolling spring of Yade does not stiffen with the load and has no dashpot; it equals type C's under ten "
        "weights",
        "walls have the moduli of the beads, as Yade takes the mean of both shear moduli, and act as beads of twice "
        "the radius",
        "contacts attract each other as an impact ends; the restitution is the same, the dashpot weaker",
        "the tangential dashpot of Yade is as strong as the normal one",
        "walls are facets: a bead on an edge between two of them is pushed by both",
    ]
    if deck.rolling != "type C":
        found.insert(0, f"Yade has no rolling resistance of {deck.rolling}; its bending moment has the same limit")
    return tuple(found)


def converted(deck: Deck) -> dict[str, Any]:
    """Return the coefficients in Yade's conventions.

    Parameters
    ----------
    deck : Deck
        Deck whose coefficients are converted.

    Returns
    -------
    dict of str to object
        The coefficients, in SI.
    """
    return {
        "restitution": [deck.contact.restitution, deck.wall_contact.restitution],
        "static_friction": [deck.contact.static_friction, deck.wall_contact.static_friction],
        "rolling_friction": [deck.contact.rolling_friction, deck.wall_contact.rolling_friction],
        "krot_n_m_per_rad": rolling_stiffness(deck, deck.laws[0], deck.particle.typical.radius / 2),
        "rolling_friction_arm": "own radius",
    }


def files(deck: Deck) -> dict[str, str]:
    """Return the script and its numbers.

    Parameters
    ----------
    deck : Deck
        Deck that the script runs.

    Returns
    -------
    dict of str to str
        Contents by name.
    """
    scene, bead = deck.scene, deck.soft
    numbers = {
        "radius": bead.typical.radius,
        "radii": (diameters(deck) / 2).tolist(),
        "density": bead.effective_density,
        "young": bead.material.youngs_modulus,
        "poisson": bead.material.poisson_ratio,
        **converted(deck),
        "gravity": GRAVITY,
        "time_step": deck.time_step,
        "look": LOOK,
        "mass": bead.mean_mass,
        "low": scene.low.tolist(),
        "high": scene.high.tolist(),
        "walls": {name: triangles(shape).tolist() for name, shape in scene.walls.items()},
        "places": scene.places.tolist(),
        "velocities": scene.velocities.tolist(),
        "stages": [
            {"kind": type(stage).__name__, "speed": stage.speed, "batches": [batch.tolist() for batch in stage.batches]}
            if isinstance(stage, Pour)
            else {"kind": type(stage).__name__, **asdict(stage)}
            for stage in scene.stages
        ],
    }
    said = "".join(f"# {words}\n" for words in deck.warnings)
    head = (
        f"# {deck.rig_name} with {scene.count} beads of {deck.particle.name}, seed {deck.seed}; SI\n"
        f"# run in this folder: {COMMAND}\n"
        f"# numbers in Yade's conventions: {NUMBERS}; in rigtwin's: deck.json\n{said}"
    )
    return {NAME: head + SCRIPT, NUMBERS: json.dumps(numbers) + "\n"}


SCRIPT = (
    '''import json
import math
import os
import sys

D = json.load(open("'''
    + NUMBERS
    + '''"))
for old in ("'''
    + f'{RECORD}", "{END}'
    + '''"):
    if os.path.exists(old):
        os.remove(old)
radius, low, high = D["radius"], D["low"], D["high"]


def material(label, friction):
    return O.materials.append(FrictMat(
        young=D["young"], poisson=D["poisson"], density=D["density"], frictionAngle=math.atan(friction), label=label))


bead, wall = material("bead", D["static_friction"][0]), material("wall", D["static_friction"][1])


def pairs(values):
    return MatchMaker(matches=((bead, bead, values[0]), (bead, wall, values[1])))


walls = {
    name: O.bodies.append([facet([Vector3(*c) for c in t], material=wall, fixed=True) for t in corners])
    for name, corners in D["walls"].items()
}
beads = {}  # number of each bead by its id


def add(place, velocity):
    body = sphere(Vector3(*place), D["radii"][len(beads)], material=bead)
    body.state.vel = Vector3(*velocity)
    beads[O.bodies.append(body)] = len(beads) + 1


def tidy():
    """Erase beads outside the room."""
    for id in list(alive()):
        p = O.bodies[id].state.pos
        if any(p[k] < low[k] or p[k] > high[k] for k in range(3)):
            O.bodies.erase(id)


def alive():
    return [id for id in beads if O.bodies[id] is not None]


def wall_rolling():
    """The limit of rolling at walls differs from that among beads, and Yade takes only one coefficient."""
    for ids in walls.values():
        for id in ids:
            for contact in O.bodies[id].intrs():
                if contact.isReal:
                    ball = O.bodies[contact.id1 if contact.id2 == id else contact.id2]
                    contact.phys.maxBendPl = D["rolling_friction"][1] * ball.shape.radius


turning = RotationEngine(
    ids=[id for ids in walls.values() for id in ids], angularVelocity=0.0, rotationAxis=(0, 1, 0),
    rotateAroundZero=True, zeroPoint=(0, 0, 0), dead=True)
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Facet_Aabb()], verletDist=0.1 * min(D["radii"])),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom(), Ig2_Facet_Sphere_ScGeom()],
        [Ip2_FrictMat_FrictMat_MindlinPhys(
            en=pairs(D["restitution"]),
            frictAngle=pairs([math.atan(value) for value in D["static_friction"]]),
            krot=D["krot_n_m_per_rad"], eta=D["rolling_friction"][0])],
        [Law2_ScGeom_MindlinPhys_Mindlin(includeMoment=max(D["rolling_friction"]) > 0)]),
    turning,
    NewtonIntegrator(damping=0, gravity=(0, 0, -D["gravity"])),
    PyRunner(command="wall_rolling()", iterPeriod='''
    + str(WALL_ROLLING_EVERY)
    + """),
]
O.dt = D["time_step"]
for place, velocity in zip(D["places"], D["velocities"]):
    add(place, velocity)


def run(duration):
    O.run(max(1, round(duration / O.dt)), True)
    tidy()


def write(name, mode):
    ids = alive()
    with open(name, mode) as file:
        file.write("ITEM: TIMESTEP\\n%d\\nITEM: NUMBER OF ATOMS\\n%d\\n" % (O.iter, len(ids)))
        file.write("ITEM: BOX BOUNDS ff ff ff\\n")
        for k in range(3):
            file.write("%g %g\\n" % (low[k], high[k]))
        file.write("ITEM: ATOMS id x y z vx vy vz\\n")
        for id in ids:
            state = O.bodies[id].state
            file.write("%d %.9g %.9g %.9g %.9g %.9g %.9g\\n" % (beads[id], *state.pos, *state.vel))


def resting(still):
    energies = [O.bodies[id].state.vel.squaredNorm() for id in alive()]
    mean = 0.5 * D["mass"] * sum(energies) / max(1, len(energies))
    limit = still["energy"] * D["mass"] * D["gravity"] * radius
    return mean < limit and max(energies, default=0) < still["speed"] ** 2


for stage in D["stages"]:
    kind = stage["kind"]
    if kind == "Pour":
        for batch in stage["batches"]:
            for place in batch:
                add(place, (0, 0, -stage["speed"]))
            run(D["look"])
    elif kind == "Open":
        for id in walls.pop(stage["wall"]):
            O.bodies.erase(id)
    elif kind == "Settle":
        for _ in range(round(stage["limit"] / D["look"])):
            run(D["look"])
            if resting(stage["still"]):
                break
    elif kind == "Turn":
        turning.angularVelocity, turning.dead = stage["spin"], False
        write('"""
    + RECORD
    + """', "w")
        for _ in range(max(1, round(stage["duration"] / stage["interval"]))):
            run(stage["interval"])
            write('"""
    + RECORD
    + """', "a")
    elif kind == "Drain":
        write('"""
    + RECORD
    + """', "w")
        for _ in range(max(1, round(stage["limit"] / stage["interval"]))):
            run(stage["interval"])
            write('"""
    + RECORD
    + """', "a")
            if not any(O.bodies[id].state.pos[2] > 0 for id in alive()):
                break
write('"""
    + END
    + """', "w")
sys.stdout.flush()
os._exit(0)
"""
)
