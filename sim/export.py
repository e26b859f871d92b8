"""What a twin of many particles computes with, in the words and conventions of other codes."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

from rigtwin import __version__
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rolling_conventions import Arm, rolling_friction

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

Code = Literal["edem", "liggghts"]

CODES = get_args(Code)
ARM: dict[Code, Arm] = {"edem": "own radius", "liggghts": "effective radius"}  # EDEM: "standard rolling friction"
ROLLING: dict[Rolling, str] = {"type A": "cdt", "type A explicit": "cdt", "type C": "epsd2"}  # as LIGGGHTS calls them
DIFFERS = {  # theirs from ours
    "cdt": "cdt acts against the spin relative to the neighbour, type A against each sphere's own",
    "epsd2": "below it epsd2's spring is a quarter of type C's between equal spheres, and has no dashpot",
}
LEAST = 0.05  # [1], restitution that LIGGGHTS takes; some 0.21 comes out
SOFT, HARD = 5e6, 1e9  # [Pa], moduli between which LIGGGHTS asks for no confirmation


@dataclass(frozen=True)
class Export:
    """Parameters as a code takes them."""

    code: Code
    particle: Particle  # its material as soft as the model's
    wall: Material  # as soft as the model's
    between: Contact  # in the code's conventions
    at_wall: Contact  # in the code's conventions
    rolling: Rolling
    time_step: float  # [s]
    given: tuple[Contact, Contact]  # in ours
    stiffness_factor: float  # [1]
    warnings: tuple[str, ...]

    @property
    def text(self) -> str:
        """For a person, or for the code to read."""
        return _for_liggghts(self) if self.code == "liggghts" else _for_edem(self)

    def to_json(self) -> dict[str, Any]:
        """All of it as plain numbers and texts, SI."""
        return {
            "code": self.code,
            "particle": {
                "name": self.particle.name,
                "diameter_m": self.particle.diameter,
                "density_kg_per_m3": self.particle.effective_density,
            },
            "materials": [_moduli(self.particle.material), _moduli(self.wall)],
            "contacts": {"particle-particle": asdict(self.between), "particle-wall": asdict(self.at_wall)},
            "rolling_friction_arm": ARM[self.code],
            "rolling_model": "standard" if self.code == "edem" else ROLLING[self.rolling],
            "stiffness_factor": self.stiffness_factor,
            "time_step_s": self.time_step,
            "warnings": list(self.warnings),
        }


def export(
    code: Code,
    particle: Particle,
    wall: Material,
    between: Contact,
    at_wall: Contact,
    *,
    rolling: Rolling = "type C",
    stiffness_factor: float = 1e-3,
    time_step_fraction: float = 0.3,
) -> Export:
    """Particle, wall and their contacts for another code, as stiff and with the step [of Rayleigh's] of our twin.

    Raises `BadInput` for an unknown code and for clumps, whose spheres other codes are told in ways of their own.
    """
    from rigtwin.sim.engine.time_step import time_step

    if code not in CODES:
        raise BadInput(f"code: {code!r} is unknown; use {' or '.join(map(repr, CODES))}.")
    if particle.shape is not None:
        raise BadInput(f"{particle.name}: is a clump of spheres; only single spheres are exported.")
    soft = replace(particle, material=particle.material.softened(stiffness_factor))
    step, warnings = time_step([soft], time_step_fraction)
    return Export(
        code,
        soft,
        wall.softened(stiffness_factor),
        _converted(between, code, particle.radius, particle.radius),
        _converted(at_wall, code, particle.radius, math.inf),
        rolling,
        step,
        (between, at_wall),
        stiffness_factor,
        warnings,
    )


def _converted(contact: Contact, code: Code, radius: float, other: float) -> Contact:
    """A contact of spheres of these radii [m] in the code's conventions."""
    rolls = rolling_friction(contact.rolling_friction, radius, other, arm=ARM[code])
    if code == "edem":
        return replace(contact, rolling_friction=rolls)
    return replace(contact, rolling_friction=rolls, restitution=_of_usual_damping(contact.restitution))


def _of_usual_damping(restitution: float) -> float:
    """What to give to a code that damps by psi = -ln e / sqrt(pi^2 + ln^2 e) and lets no contact pull."""
    from rigtwin.sim.engine.contact import damping_ratio

    psi = damping_ratio(restitution)
    usual = math.exp(-math.pi * psi / math.sqrt(1 - psi**2)) if psi < 1 else 0.0
    if usual < LEAST:
        raise BadInput(f"restitution {restitution:g} is below what LIGGGHTS can damp to; give 0.22 or more.")
    return usual


def _moduli(material: Material) -> dict[str, Any]:
    return {
        "name": material.name,
        "youngs_modulus_pa": material.youngs_modulus,
        "poisson_ratio": material.poisson_ratio,
        "density_kg_per_m3": material.density,
    }


def _for_liggghts(made: Export) -> str:
    """Commands for `include` behind `create_box 2 ...`: type 1 is the particle, type 2 the walls."""
    bead, wall = made.particle, made.wall
    moduli = (bead.material.youngs_modulus, wall.youngs_modulus)
    confirmed = [word for word, odd in (("soft", min(moduli) < SOFT), ("hard", max(moduli) > HARD)) if odd]
    before = "".join(f"# it wants, before atom_style: {word}_particles yes\n" for word in confirmed)

    def each(name: str, ours: float, theirs: float) -> str:
        return f"fix {name} all property/global {name} peratomtype {ours:.10g} {theirs:.10g}\n"

    def pairs(name: str, between: float, at_wall: float) -> str:
        four = " ".join(f"{value:.10g}" for value in (between, at_wall, at_wall, at_wall))
        return f"fix {name} all property/global {name} peratomtypepair 2 {four}\n"

    among, against = made.between, made.at_wall
    model = f"model hertz tangential history rolling_friction {ROLLING[made.rolling]}"
    return (
        f"# {bead.name} (type 1), walls of {wall.name} (type 2), rigtwin {__version__}, for LIGGGHTS 3.8; SI\n"
        "# include behind create_box 2\n"
        f"{before}"
        f"# spheres: diameter {bead.diameter:.10g} density {bead.effective_density:.10g}\n"
        f"# between {_told(made.given[0])}, at walls {_told(made.given[1])}; in LIGGGHTS:\n"
        "# restitution is smaller here, for it comes out larger than it was given where a contact may not pull;\n"
        "# rolling friction is mu_r Fn R_eff here and not mu_r Fn R, R_eff being R / 2 between equal spheres: twice;\n"
        f"# the torque's limit is the same, but\n# {DIFFERS[ROLLING[made.rolling]]}\n"
        + "".join(f"# {words}\n" for words in (*_softened(made), *made.warnings))
        + each("youngsModulus", *moduli)
        + each("poissonsRatio", bead.material.poisson_ratio, wall.poisson_ratio)
        + pairs("coefficientRestitution", among.restitution, against.restitution)
        + pairs("coefficientFriction", among.static_friction, against.static_friction)
        + pairs("coefficientRollingFriction", among.rolling_friction, against.rolling_friction)
        + f"pair_style gran {model}\npair_coeff * *\n"
        + f"# a wall: fix NAME all wall/gran {model} primitive type 2 ...\n"
        + f"timestep {made.time_step:.10g}\n"
    )


def _softened(made: Export) -> tuple[str, ...]:
    if made.stiffness_factor == 1:
        return ()
    return (
        f"the moduli are {made.stiffness_factor:g} of the materials' own (--stiffness-factor); the time step is theirs",
    )


def _told(contact: Contact) -> str:
    return f"e {contact.restitution:g}, mu {contact.static_friction:g}, mu_r {contact.rolling_friction:g}"


def _for_edem(made: Export) -> str:
    """Lines to type in: EDEM keeps its projects in files of its own."""
    bead, wall = made.particle, made.wall
    rows = (bead.material, bead.effective_density), (wall, wall.density)
    materials = [
        f"material {material.name}: Poisson's ratio {material.poisson_ratio:g}, solids density {density:g} kg/m3, "
        f"shear modulus {material.shear_modulus:g} Pa"
        for material, density in rows
    ]
    contacts = [
        f"interaction {bead.name} - {name}: restitution {contact.restitution:g}, static friction "
        f"{contact.static_friction:g}, rolling friction {contact.rolling_friction:g}"
        for name, contact in ((bead.name, made.between), (wall.name, made.at_wall))
    ]
    lines = [
        f"{bead.name} and walls of {wall.name}, rigtwin {__version__}",
        "contact model: Hertz-Mindlin (no slip) with standard rolling friction, at most mu_r Fn R on each sphere",
        f"sphere: radius {1e3 * bead.radius:g} mm",
        *materials,
        *contacts,
        f"time step {made.time_step:g} s",
        f"the torque's limit is that of our {made.rolling}"
        + (", which springs back below it: EDEM's standard model does not" if made.rolling == "type C" else ""),
        *_softened(made),
        *made.warnings,
    ]
    return "\n".join(lines) + "\n"
