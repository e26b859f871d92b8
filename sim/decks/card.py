"""Material cards: the parameters of a simulation in the conventions of other DEM codes (EDEM, LIGGGHTS), or as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rolling_conventions import Arm, rolling_friction
from rigtwin.lab.version import __version__

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

Code = Literal["edem", "liggghts", "csv"]

CODES = get_args(Code)
# EDEM: "standard rolling friction"; CSV: as rigtwin itself
ARM: dict[Code, Arm] = {"edem": "own radius", "liggghts": "effective radius", "csv": "own radius"}
ROLLING: dict[Rolling, str] = {"type A": "cdt", "type A explicit": "cdt", "type C": "epsd2"}  # names in LIGGGHTS
DIFFERS = {  # remaining difference of LIGGGHTS's model from ours, for the header of the file
    "cdt": "cdt acts against the spin relative to the neighbour, type A against each sphere's own",
    "epsd2": "below the limit the spring of epsd2 is a quarter of type C's between equal spheres, without dashpot",
}
LEAST = 0.05  # [1], smallest restitution that LIGGGHTS accepts; the simulated one is then about 0.21
SOFT, HARD = 5e6, 1e9  # [Pa], range of moduli that LIGGGHTS accepts without confirmation


@dataclass(frozen=True)
class Export:
    """Parameters in the conventions of another code."""

    code: Code
    particle: Particle  # with softened moduli
    wall: Material  # with softened moduli
    between: Contact  # in the code's conventions
    at_wall: Contact  # in the code's conventions
    rolling: Rolling
    time_step: float  # [s]
    given: tuple[Contact, Contact]  # `between` and `at_wall` in rigtwin's conventions
    stiffness_factor: float  # [1]
    warnings: tuple[str, ...]
    others: tuple[Export, ...] = ()
    """The same for walls of other materials, types 3, 4 ... of LIGGGHTS."""

    @property
    def text(self) -> str:
        """Text output: a LIGGGHTS input file, a list for EDEM's dialogs, or a CSV table."""
        return {"liggghts": _for_liggghts, "edem": _for_edem, "csv": _as_csv}[self.code](self)

    def to_json(self) -> dict[str, Any]:
        """All parameters as plain numbers and strings, SI units."""
        return {
            "code": self.code,
            "particle": {
                "name": self.particle.name,
                "diameter_m": self.particle.diameter,
                "density_kg_per_m3": self.particle.effective_density,
                **_shape(self.particle),
            },
            "materials": [_moduli(self.particle.material), _moduli(self.wall)],
            "contacts": {"particle-particle": asdict(self.between), "particle-wall": asdict(self.at_wall)},
            "rolling_friction_arm": ARM[self.code],
            "rolling_model": {"edem": "standard", "csv": self.rolling}.get(self.code) or ROLLING[self.rolling],
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
    forced: bool = False,
) -> Export:
    """Convert the parameters of a simulation to the conventions of another DEM code.

    Parameters
    ----------
    code : {"edem", "liggghts", "csv"}
        Target code.
    particle : Particle
        A sphere, or a clump; sizes that differ become at most ten classes.
    wall : Material
        Material of the walls.
    between, at_wall : Contact
        Coefficients of contacts between particles, and of particles with walls.
    rolling : {"type A", "type A explicit", "type C"}
        Rolling resistance model.
    stiffness_factor : float
        Factor of Young's moduli [1].
    time_step_fraction : float
        Time step over Rayleigh's time step [1].
    forced : bool
        Accept even an unstable time step.

    Returns
    -------
    Export
        Converted parameters; `Export.text` is the output as text, `Export.to_json` as plain data.

    Raises
    ------
    BadInput
        If the code is unknown, the time step is refused, or a restitution is below what LIGGGHTS can reach.

    Notes
    -----
    Rolling friction is rescaled because the codes multiply it by different radii: EDEM by the radius of the sphere,
    LIGGGHTS by the effective radius.  For LIGGGHTS the restitution e is converted, too: it damps with
    psi = -ln e / sqrt(pi^2 + ln^2 e) and allows no attraction, so a contact restitutes more than the value given.

    Examples
    --------
    >>> from rigtwin.lab.materials import Contact, Material, Particle
    >>> glass = Material("glass", youngs_modulus=63e9, poisson_ratio=0.22, density=2500.0)
    >>> made = export("edem", Particle("bead", glass, 6e-3), glass, Contact(0.8), Contact(0.8))
    >>> made.between.restitution
    0.8
    """
    from rigtwin.sim.engine.time_step import time_step

    if code not in CODES:
        raise BadInput(f"code: {code!r} is unknown; use {' or '.join(map(repr, CODES))}.")
    soft = replace(particle, material=particle.material.softened(stiffness_factor))
    least = min(between.restitution, at_wall.restitution)
    step, warnings = time_step([soft], time_step_fraction, forced=forced, restitution=least)
    if particle.sizes is not None and code == "csv":
        of = "" if particle.shape is None else ", its spheres"
        warnings += (
            f"diameter{of}, mass and moments of {particle.name} are those of its largest size, "
            f"{1e3 * particle.equivalent_diameter:.4g} mm; rows `size` have the others with their shares of the mass",
        )
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


def _shape(particle: Particle) -> dict[str, Any]:
    """Spheres, mass and moments of a clump, and classes of sizes, where there are any."""
    found: dict[str, Any] = {}
    if particle.shape is not None:
        spheres = [[*place, radius] for place, radius in zip(particle.shape.offsets, particle.radii, strict=True)]
        found |= {"spheres_m": spheres, "mass_kg": particle.mass, "moments_kg_m2": list(particle.moments)}
    if particle.sizes is not None:
        found["classes"] = [{"diameter_m": d, "share_by_mass": share} for d, share in particle.sizes.classes()]
    return found


def _converted(contact: Contact, code: Code, radius: float, other: float) -> Contact:
    """Contact of spheres of these radii [m] in the conventions of `code`."""
    rolls = rolling_friction(contact.rolling_friction, radius, other, arm=ARM[code])
    if code != "liggghts":
        return replace(contact, rolling_friction=rolls)
    return replace(contact, rolling_friction=rolls, restitution=of_usual_damping(contact.restitution))


def of_usual_damping(restitution: float) -> float:
    """Return the restitution that gives the same rebound in a code with the usual damping, which allows no attraction.

    Parameters
    ----------
    restitution : float
        Restitution here [1].

    Returns
    -------
    float
        Input value [1] for a code that damps by psi = -ln e / sqrt(pi^2 + ln^2 e).

    Raises
    ------
    BadInput
        If it is below what LIGGGHTS can reach.
    """
    from rigtwin.sim.engine.contact import damping_ratio

    psi = damping_ratio(restitution)
    usual = math.exp(-math.pi * psi / math.sqrt(1 - psi**2)) if psi < 1 else 0.0
    if usual < LEAST:
        raise BadInput(f"restitution {restitution:g} is below the smallest that LIGGGHTS can reach; give 0.22 or more.")
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
    walls = (made, *made.others)
    moduli = (bead.material.youngs_modulus, *(one.wall.youngs_modulus for one in walls))
    confirmed = [word for word, odd in (("soft", min(moduli) < SOFT), ("hard", max(moduli) > HARD)) if odd]
    before = "".join(f"# required before atom_style: {word}_particles yes\n" for word in confirmed)

    def each(name: str, *values: float) -> str:
        listed = " ".join(f"{value:.10g}" for value in values)
        return f"fix {name} all property/global {name} peratomtype {listed}\n"

    def pairs(name: str, coefficient: str) -> str:
        first = [getattr(made.between, coefficient), *(getattr(one.at_wall, coefficient) for one in walls)]
        # between two walls anything will do, as they do not touch each other
        walled = range(1, len(first))
        rows = [first, *([first[i], *(first[min(i, j)] for j in walled)] for i in walled)]
        listed = " ".join(f"{value:.10g}" for row in rows for value in row)
        return f"fix {name} all property/global {name} peratomtypepair {len(first)} {listed}\n"

    model = f"model hertz tangential history rolling_friction {ROLLING[made.rolling]}"
    more = "".join(f", of {one.wall.name} (type {k})" for k, one in enumerate(made.others, start=3))
    return (
        f"# {bead.name} (type 1), walls of {wall.name} (type 2){more}, rigtwin {__version__}, for LIGGGHTS 3.8; SI\n"
        f"# include behind create_box {1 + len(walls)}\n"
        f"{before}"
        f"{_templates(bead)}"
        f"# between {_coefficients(made.given[0])}, at walls {_coefficients(made.given[1])}; in LIGGGHTS:\n"
        "# restitution is smaller here, as LIGGGHTS allows no attraction in a contact and then restitutes more;\n"
        "# rolling friction is mu_r Fn R_eff here and not mu_r Fn R, R_eff being R / 2 between equal spheres: twice;\n"
        f"# the limit of the torque is the same, but\n# {DIFFERS[ROLLING[made.rolling]]}\n"
        + "".join(f"# {words}\n" for words in (*_softened(made), *made.warnings))
        + each("youngsModulus", *moduli)
        + each("poissonsRatio", bead.material.poisson_ratio, *(one.wall.poisson_ratio for one in walls))
        + pairs("coefficientRestitution", "restitution")
        + pairs("coefficientFriction", "static_friction")
        + pairs("coefficientRollingFriction", "rolling_friction")
        + f"pair_style gran {model}\npair_coeff * *\n"
        + f"# a wall: fix NAME all wall/gran {model} primitive type 2 ...\n"
        + f"timestep {made.time_step:.10g}\n"
    )


def _templates(bead: Particle) -> str:
    """What LIGGGHTS's `fix insert` takes; the single sphere, which any deck can make, as a comment."""
    density = f"density constant {bead.effective_density:.10g}"
    if bead.shape is None and bead.sizes is None:
        return f"# spheres: diameter {bead.diameter:.10g} density {bead.effective_density:.10g}\n"
    whole = bead.equivalent_diameter
    classes = [(whole, 1.0)] if bead.sizes is None else bead.sizes.classes()
    seeds = _primes(len(classes) + 1)
    said = "# insert with: fix NAME all insert/pack seed 32452843 distributiontemplate sizes ...\n"
    lines = []
    for number, ((diameter, _), seed) in enumerate(zip(classes, seeds, strict=False), start=1):
        kind = f"fix size{number} all particletemplate"
        if bead.shape is None:
            lines.append(f"{kind}/sphere {seed} atom_type 1 {density} radius constant {diameter / 2:.10g}\n")
            continue
        size, clump = diameter / whole, bead.shape
        spheres = "".join(
            f" &\n  {' '.join(f'{size * value:.10g}' for value in (*place, radius))}"
            for place, radius in zip(clump.offsets, clump.radii, strict=True)
        )
        x, y, z = (size**5 * one for one in bead.moments)
        weight = f"mass {size**3 * bead.mass:.10g} inertia_tensor {x:.10g} 0 0 {y:.10g} 0 {z:.10g} use_density"
        lines.append(
            f"{kind}/multisphere {seed} atom_type 1 {density} nspheres {len(clump.radii)} ntry 1000000 "
            f"spheres{spheres} &\n  type {number} {weight}\n"
        )
    if bead.shape is not None:
        said = (
            "# with atom_modify map array, and fix NAME all multisphere in place of nve/sphere; "
            + said.removeprefix("# ")
        )
    weights = " ".join(f"size{number} {share:.10g}" for number, (_, share) in enumerate(classes, start=1))
    mixed = f"fix sizes all particledistribution/discrete {seeds[-1]} {len(classes)} {weights}\n"
    return said + "".join(lines) + mixed


def _primes(count: int) -> list[int]:
    """Primes, as LIGGGHTS takes no other seeds."""
    found: list[int] = []
    candidate = 15_485_863
    while len(found) < count:
        if all(candidate % each for each in range(2, math.isqrt(candidate) + 1)):
            found.append(candidate)
        candidate += 2
    return found


def _softened(made: Export) -> tuple[str, ...]:
    if made.stiffness_factor == 1:
        return ()
    return (
        f"the moduli are {made.stiffness_factor:g} of the real ones (--stiffness-factor), as the time step assumes",
    )


def _coefficients(contact: Contact) -> str:
    return f"e {contact.restitution:g}, mu {contact.static_friction:g}, mu_r {contact.rolling_friction:g}"


def _for_edem(made: Export) -> str:
    """List of values to type in: EDEM has a project format of its own."""
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
        *_spheres(bead),
        *materials,
        *contacts,
        f"time step {made.time_step:g} s",
        f"the limit of the rolling torque is that of rigtwin's {made.rolling}"
        + (", which springs back below it: EDEM's standard model does not" if made.rolling == "type C" else ""),
        *_softened(made),
        *made.warnings,
    ]
    return "\n".join(lines) + "\n"


def _spheres(bead: Particle) -> list[str]:
    lines = [f"sphere: radius {1e3 * bead.radius:g} mm"]
    if bead.shape is not None:
        lines = [
            f"sphere {number}: x {1e3 * x:.6g} mm, y {1e3 * y:.6g} mm, z {1e3 * z:.6g} mm, radius {1e3 * radius:.6g} mm"
            for number, ((x, y, z), radius) in enumerate(zip(bead.shape.offsets, bead.radii, strict=True), start=1)
        ]
        moments = ", ".join(f"{axis} {one:.6g}" for axis, one in zip("xyz", bead.moments, strict=True))
        lines.append(f"mass {bead.mass:.6g} kg, volume {bead.volume:.6g} m3, moments of inertia {moments} kg m2")
    if bead.sizes is not None:
        lines += [
            f"size {diameter / bead.equivalent_diameter:.4g} of it ({1e3 * diameter:.4g} mm): {100 * share:.3g} % of "
            "the mass"
            for diameter, share in bead.sizes.classes()
        ]
    return lines


def _as_csv(made: Export) -> str:
    """A row for each material and each contact; cells that do not apply are empty."""
    names = (
        "kind", "name", "diameter_m", "density_kg_per_m3", "youngs_modulus_pa", "shear_modulus_pa", "poisson_ratio",
        "restitution", "static_friction", "rolling_friction", "rolling_model", "rolling_friction_arm",
        "stiffness_factor", "time_step_s", "mass_kg", "x_m", "y_m", "z_m", "share_by_mass",
    )  # fmt: skip
    bead, wall = made.particle, made.wall

    def solid(kind: str, name: str, material: Material, density: float, diameter: str) -> list[str]:
        values = (density, material.youngs_modulus, material.shear_modulus, material.poisson_ratio)
        rest = ["", "", "", "", "", f"{made.stiffness_factor:.10g}", f"{made.time_step:.10g}" if diameter else ""]
        rest += [f"{bead.mass:.10g}" if diameter else "", "", "", "", ""]
        return [kind, name, diameter, *(f"{value:.10g}" for value in values), *rest]

    def pair(name: str, contact: Contact) -> list[str]:
        values = (contact.restitution, contact.static_friction, contact.rolling_friction)
        said = [*(f"{value:.10g}" for value in values), made.rolling, ARM[made.code]]
        return ["contact", name, "", "", "", "", "", *said, *[""] * 7]

    def part(kind: str, diameter: float, place: Sequence[float], share: str = "") -> list[str]:
        where = [f"{value:.10g}" for value in place] or ["", "", ""]
        return [kind, bead.name, f"{diameter:.10g}", *[""] * 12, *where, share]

    rows: list[Sequence[str]] = [
        names,
        solid("particle", bead.name, bead.material, bead.effective_density, f"{bead.diameter:.10g}"),
        solid("wall", wall.name, wall, wall.density, ""),
        pair(f"{bead.name}-{bead.name}", made.between),
        pair(f"{bead.name}-{wall.name}", made.at_wall),
    ]
    if bead.shape is not None:
        places = zip(bead.shape.offsets, bead.radii, strict=True)
        rows += [part("sphere", 2 * radius, place) for place, radius in places]
    if bead.sizes is not None:
        rows += [part("size", diameter, (), f"{share:.10g}") for diameter, share in bead.sizes.classes()]
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows(rows)
    return table.getvalue()
