"""Particles, materials and calibrated contacts of Hlosta et al. 2020, by name.

Source: J. Hlosta, L. Jezerska, J. Rozbroj, D. Zurovec, J. Necas, J. Zegzulka, "DEM Investigation of the Influence of
Particulate Properties and Operating Conditions on the Mixing Process in Rotary Drums: Part 1", Processes 8(2), 222
(2020), doi 10.3390/pr8020222.  Its tables stand beside this module as CSV, as printed, under CC BY 4.0.

Slips of the paper, and what is done about them here:

- Table 13 prints the time step at G = 1e10 Pa as 2.45e-7 s; the row's neighbours make it 2.45e-6 s.  `table(13)`
  gives the corrected value.  All its steps are 100 % of the Rayleigh step of a 6.2 mm bead, where the text says 30 %.
- Table A1 repeats table 2 with the moduli in MPa instead of GPa: the model's stiffness is reduced to a thousandth
  (section 3.3).  `material` gives the real one; ``material(name).softened(SOFTENING)`` that of the model.
- Table A6 is headed "coefficient of restitution" and holds the static friction; table 16 carries table 15's title and
  holds discharge times.
- The restitution of D6 beads is 0.73 measured (table 12) and 0.75 calibrated (table A3).  The unlike pairs of both
  tables are not measured: they follow from the like pairs of table 12 by eq. (8), `mixed_restitution`.
- Table 3's volumes are those of the enlarged beads (4.2, 6.2 and 12.2 mm) that the calibrated model uses.
- The layouts of the clumps are not printed.  Those here are the ones of round sizes that match table 3's volumes;
  `shape` says how.
- Table 10 gives the measured rolling friction on a wall, the tangent of an angle (eq. 4); table A7 the calibrated
  coefficient of the contact model, a torque mu_r Fn R on each body.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import product

from rigtwin.lab.clumps import Clump, clump, cubic
from rigtwin.lab.clumps import row as spheres_in_a_row
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle, clumped

CITATION = "Hlosta et al. 2020"
SOFTENING = 1e-3
"""Stiffness of the calibrated model over the real one (section 3.3; table A1 against table 2)."""

PARTICLES = ("D4", "D6", "D12", "C6", "P6x15", "D6_ABS", "D5_steel")
MATERIALS = ("steel", "aluminum", "glass", "PMMA", "ABS", "wood_ash")
CLUMPS = {
    **dict.fromkeys(("C6_1s", "C6_8s-a", "C6_8s-b", "C6_9s", "C6_16s", "C6_24s", "C6_28s"), "C6"),
    **dict.fromkeys(("P6x15_3s", "P6x15_5s"), "P6x15"),
}
"""Virtual particles that stand for the cube and the pellet."""
NAMES = (*PARTICLES, *CLUMPS)
ENLARGED_BY = 0.2e-3
"""[m], of the wooden beads and the cube of 24 spheres, after table 7 (section 3.1)."""
CALIBRATED = {"C6": "C6_24s", "P6x15": "P6x15_5s"}
"""Which of them the calibrated model uses (the densities of table A2 are theirs)."""
WALLS = ("steel", "PMMA", "aluminum", "glass")

Row = dict[str, str | float]

_DIAMETERS = {"D4": 4e-3, "D6": 6e-3, "D12": 12e-3, "D6_ABS": 6e-3, "D5_steel": 5e-3}  # [m], before some were enlarged
_ENLARGED = ("D4", "D6", "D12")
_MATERIAL_OF = {"D6_ABS": "ABS", "D5_steel": "steel"}
_CORRECTED = {("13", "shear_modulus_pa", 1e10): {"timestep_s": 2.45e-6}}


@dataclass(frozen=True)
class Measured:
    """A measured mean with the standard deviation of its ten repetitions (not of the mean)."""

    value: float  # in `unit`
    std: float  # in `unit`
    unit: str
    source: str


def material(name: str) -> Material:
    """Return a material with its real stiffness (table 2).

    Parameters
    ----------
    name : str
        One of `MATERIALS`.

    Returns
    -------
    Material
        The material.

    Raises
    ------
    BadInput
        If there is no such material.

    Examples
    --------
    >>> material("glass").youngs_modulus
    70000000000.0
    """
    row = _row("2", "there is no such material", material=name)
    return Material(name, _of(row, "density_kg_m3"), _of(row, "youngs_modulus_gpa") * 1e9, _of(row, "poisson_ratio"))


def particle(name: str, *, enlarged: bool = True) -> Particle:
    """Return a particle of the calibrated model, or a virtual one that stands for the cube or the pellet.

    A sphere has the diameter of table 3 and the density of table A2; a clump has the `shape` of its name and the real
    particle's mass (table 3).

    Parameters
    ----------
    name : str
        One of `NAMES`.
    enlarged : bool
        Whether wooden beads and the cube of 24 spheres are 0.2 mm larger, as the paper made them after table 7 (section
        3.1); the mass is the same.

    Returns
    -------
    Particle
        The particle.

    Raises
    ------
    BadInput
        If there is no such particle.

    Examples
    --------
    >>> bead = particle("D6")
    >>> bead.diameter, bead.effective_density
    (0.0062, 569.0)
    >>> round(particle("C6_24s").mass * 1e3, 3)
    0.139
    """
    solid = material(_MATERIAL_OF.get(name, "wood_ash"))
    if name in CALIBRATED or name in CLUMPS:
        layout = shape(CALIBRATED.get(name, name), enlarged=enlarged)
        return clumped(name, solid, layout, mass=_real_mass(CLUMPS.get(name, name)))
    row = _row("A2", "there is no such particle", particle=name)
    smaller = _DIAMETERS[name]
    larger = round(smaller + ENLARGED_BY, 6) if name in _ENLARGED else smaller
    density = _of(row, "density_kg_m3")  # of the larger one
    if enlarged:
        return Particle(name, solid, larger, density)
    return Particle(name, solid, smaller, density * (larger / smaller) ** 3)


@cache
def shape(name: str, *, enlarged: bool = True) -> Clump:
    """Return a clump.  The paper prints its number of spheres and, for all but C6_28s, its volume.

    Parameters
    ----------
    name : str
        One of `CLUMPS`.
    enlarged : bool
        Whether the spheres of C6_24s, in their places, are 2.2 mm and not 2 mm.

    Returns
    -------
    Clump
        The clump.

    Raises
    ------
    BadInput
        If there is no such clump.

    Notes
    -----
    Pellets are rows of spheres of 6 mm; the spacing follows from the volume, and is 4.70 mm for three and 2.35 mm for
    five: both are 15.4 mm long.  Cubes lie in a cube of 6 mm and their spheres touch its faces: one sphere of 6 mm
    (1s); eight of 3 mm that touch each other (8s-a), of 4 mm that overlap (8s-b), of 2 mm around one of 6 mm (9s); 24
    of 2 mm that touch each other, three layers of three by three without the middle one of each (24s).  The paper
    enlarged the last after table 7 by 0.2 mm (section 3.1).  These match table 3 to 0.1 % with round numbers, so they
    are likely the paper's own.  The others are guesses: 16s is 8s-b with a smaller sphere in each corner; 28s is a big
    sphere and a small one in each corner and one on each edge, of the sizes that come nearest to the cube's surface.
    """
    corner, edge = (1.0, 1.0, 1.0), (1.0, 1.0, 0.0)
    match name:
        case "P6x15_3s":
            return spheres_in_a_row(3, 3e-3, 4.70e-3)
        case "P6x15_5s":
            return spheres_in_a_row(5, 3e-3, 2.35e-3)
        case "C6_1s":
            return cubic(6e-3, ((0.0, 0.0, 0.0), 3e-3))
        case "C6_8s-a":
            return cubic(6e-3, (corner, 1.5e-3))
        case "C6_8s-b":
            return cubic(6e-3, (corner, 2e-3))
        case "C6_9s":
            return cubic(6e-3, (corner, 1e-3), ((0.0, 0.0, 0.0), 3e-3))
        case "C6_16s":
            return cubic(6e-3, (corner, 2e-3), (corner, 0.81e-3))
        case "C6_24s":
            steps = (-2e-3, 0.0, 2e-3)
            places = [(x, y, z) for x, y, z in product(steps, steps, steps) if x or y]
            return clump(places, 1e-3 + (ENLARGED_BY / 2 if enlarged else 0.0))
        case "C6_28s":
            return cubic(6e-3, (corner, 1.43e-3), (corner, 0.72e-3), (edge, 1.5e-3))
    raise BadInput(f"{CITATION} has no clump {name!r}; known are {', '.join(CLUMPS)}.")


def contact(a: str, b: str) -> Contact:
    """Return the calibrated contact of two particles (tables A3, A5, A7) or of a particle and a wall (A4, A6, A7).

    A clump has the contacts of the particle that it stands for.  Rolling friction of two particles is the arithmetic
    mean of theirs (note 1 of table A7).

    Parameters
    ----------
    a, b : str
        Names of the two sides, in any order.

    Returns
    -------
    Contact
        The contact.

    Raises
    ------
    BadInput
        If the paper has no such contact.

    Examples
    --------
    >>> contact("steel", "D6")
    Contact(restitution=0.42, static_friction=0.36, rolling_friction=0.06)
    """
    first, second = (CLUMPS.get(name, name) for name in ((b, a) if a in WALLS else (a, b)))
    if first in PARTICLES and second in WALLS:
        wall = {"particle": first, "wall": second}
        rolling = _of(_row("A7", "", particle=first), "mu_r_pw")
        return Contact(_of(_row("A4", "", **wall), "e_pw"), _of(_row("A6", "", **wall), "mu_s_pw"), rolling)
    if first in PARTICLES and second in PARTICLES:
        rolling = sum(_of(_row("A7", "", particle=name), "mu_r_pp") for name in (first, second)) / 2
        restitution = _of(_pair_row("A3", first, second), "e_pp")
        return Contact(restitution, _of(_pair_row("A5", first, second), "mu_s_pp"), round(rolling, 6))
    raise BadInput(
        f"{CITATION} has no contact {a}-{b}; its particles are {', '.join(PARTICLES)}, its walls {', '.join(WALLS)}."
    )


def contact_tables(a: str, b: str) -> str:
    """Return where `contact` takes its numbers from.

    Parameters
    ----------
    a, b : str
        Names of the two sides, in any order.

    Returns
    -------
    str
        The tables, in words.
    """
    return "tables A4, A6, A7" if {a, b} & set(WALLS) else "tables A3, A5, A7"


def measured(quantity: str, particle: str, other: str | None = None) -> Measured:
    """Return a measured value.

    Parameters
    ----------
    quantity : str
        ``restitution_wall`` (table 11), ``restitution_pair`` (12), ``static_friction`` on a wall (8) or on another
        clump of particles (9), ``rolling_friction`` (10); ``static_friction_angle`` [deg] on a wall (8) and
        ``rolling_friction_angle`` [deg] (10).
    particle : str
        Name of the particle.
    other : str, optional
        Name of the wall or of the other particle; left out for rolling friction, for which table 10 names no wall.

    Returns
    -------
    Measured
        The value.

    Raises
    ------
    BadInput
        If the paper has no such value, or a wall is named for rolling friction.

    Examples
    --------
    >>> measured("restitution_wall", "D6", "steel")
    Measured(value=0.42, std=0.05, unit='1', source='Hlosta et al. 2020, table 11')
    """
    on_wall = other in WALLS
    column, number = {
        ("restitution_wall", True): ("e_pw", "11"),
        ("restitution_pair", False): ("e_pp", "12"),
        ("static_friction", True): ("mu_s_pw", "8"),
        ("static_friction", False): ("mu_s_pp", "9"),
        ("static_friction_angle", True): ("tilt_angle", "8"),
        ("rolling_friction", False): ("mu_r_pw", "10"),
        ("rolling_friction_angle", False): ("tilt_angle", "10"),
    }.get((quantity, on_wall), ("", ""))
    absent = f"{CITATION} has no measured {quantity} of {particle}" + (f" with {other}" if other else "")
    if not column:
        raise BadInput(f"{absent}; measured are restitution and friction, walls are {', '.join(WALLS)}.")
    if number == "10":
        row = _row(number, absent, particle=particle)
    elif on_wall:
        row = _row(number, absent, particle=particle, wall=str(other))
    else:
        row = _pair_row(number, particle, str(other), absent)
    unit = "_deg" if column == "tilt_angle" else ""
    std = f"{column}_std{unit}"
    return Measured(_of(row, column + unit), _of(row, std), "deg" if unit else "1", f"{CITATION}, table {number}")


def properties(name: str) -> list[Row]:
    """Return what table 3 prints of a particle and of each clump that stands for it, cubes and pellets included.

    Parameters
    ----------
    name : str
        One of `PARTICLES`.

    Returns
    -------
    list of dict
        Rows of the table.

    Raises
    ------
    BadInput
        If there is no such particle.

    Examples
    --------
    >>> [row["virtual_particle"] for row in properties("P6x15")]
    ['P6x15_3s', 'P6x15_5s']
    """
    rows = [row for row in table(3) if row["particle"] == name]
    if not rows:
        raise BadInput(f"{CITATION} has no particle {name!r}; known are {', '.join(PARTICLES)}.")
    return rows


def table(number: int | str, *, as_printed: bool = False) -> list[Row]:
    """Return the rows of table 2 to 16 or A2 to A7; columns carry their unit, numbers are floats.

    Table A1 is table 2 with MPa for GPa and has no file.

    Parameters
    ----------
    number : int or str
        Number of the table.
    as_printed : bool
        Whether misprints are kept.

    Returns
    -------
    list of dict
        Cells by column.

    Raises
    ------
    BadInput
        If there is no such table.

    Examples
    --------
    >>> table(13)[-1]["timestep_s"], table(13, as_printed=True)[-1]["timestep_s"]
    (2.45e-06, 2.45e-07)
    """
    name = str(number).upper()
    rows = [dict(row) for row in _printed(name)]
    if not as_printed:
        for (where, column, value), corrections in _CORRECTED.items():
            for row in rows:
                if where == name and row[column] == value:
                    row.update(corrections)
    return rows


def mixed_restitution(modulus_a: float, restitution_a: float, modulus_b: float, restitution_b: float) -> float:
    """Return the restitution of an unlike pair from those of the like pairs, weighted by stiffness.

    Parameters
    ----------
    modulus_a, restitution_a : float
        Young's modulus, in any unit, and restitution of the one [1].
    modulus_b, restitution_b : float
        Those of the other.

    Returns
    -------
    float
        (E_A e_A + E_B e_B) / (E_A + E_B) [1].

    References
    ----------
    Hlosta et al. 2020, eq. 8.

    Examples
    --------
    >>> mixed_restitution(11e9, 0.5, 11e9, 0.7)
    0.6
    """
    return (modulus_a * restitution_a + modulus_b * restitution_b) / (modulus_a + modulus_b)


def _real_mass(name: str) -> float:
    row = properties(name)[0]
    return _of(row, "total_mass_g") * 1e-3 / _of(row, "pieces")


@cache
def _printed(name: str) -> tuple[Row, ...]:
    prefix = f"table{name if name.startswith('A') else name.zfill(2)}_"
    folder = resources.files("rigtwin.lab.reference") / "tables_hlosta2020"
    for file in folder.iterdir():
        if file.name.startswith(prefix):
            lines = file.read_text(encoding="utf-8").splitlines()
            return tuple({key: _cell(cell) for key, cell in row.items()} for row in csv.DictReader(lines))
    raise BadInput(f"{CITATION} has no table {name!r} here; there are 2 to 16 and A2 to A7.")


def _cell(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def _row(number: str, absent: str, **keys: str) -> Row:
    for row in table(number):
        if all(row[key] == value for key, value in keys.items()):
            return row
    known = dict.fromkeys(str(row[next(iter(keys))]) for row in table(number))
    raise BadInput(f"{absent or CITATION}: {' and '.join(keys.values())} not in table {number} ({', '.join(known)}).")


def _pair_row(number: str, a: str, b: str, absent: str = "") -> Row:
    for row in table(number):
        if {a, b} == {row["particle"], row["particle_2"]}:
            return row
    raise BadInput(f"{absent or CITATION}: the pair {a}-{b} is not in table {number}.")


def _of(row: Row, column: str) -> float:
    return float(row[column])
