"""Materials, particles and the contacts between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rigtwin.lab.clumps import Clump
from rigtwin.lab.errors import BadInput, TwinLacks
from rigtwin.lab.size_distributions import Sizes
from rigtwin.lab.units import LARGEST_BEAD

HEAVIEST = 25_000.0  # [kg/m^3], osmium has 22 600
THINNEST = 1e-6  # [m], of a particle: what a camera resolves; else a unit is wrong
HAIR = 50e-6  # [m], below which a particle in a rig is odd: a thimble of 2 cm^3 holds 10^7
HEAVIER = 0.1  # relative excess of a particle's density: 3 % of the diameter, and scatter of wood from bead to bead
AIR_DENSITY = 1.2  # [kg/m^3], dry air of 20 degrees C at 1 atm (CRC Handbook: 1.204)
AIR_VISCOSITY = 1.81e-5  # [Pa s], dynamic, the same air (CRC Handbook: 1.813e-5)
PACKING = 0.6  # part of a poured bed's volume that is beads


def no_bead_has(density: float) -> str:
    """Return what is odd about a density that no bead has.

    Parameters
    ----------
    density : float
        The density [kg/m^3].

    Returns
    -------
    str
        A sentence; empty where the density is possible.
    """
    if AIR_DENSITY < density <= HEAVIEST:
        return ""
    than = "more than any metal" if density > HEAVIEST else "less than the air around it"
    return f"the bead would weigh {density:.3g} kg/m^3, {than}; check its unit and the bead's diameter."


def no_bead_is(width: float) -> str:
    """Return what is odd about a diameter that no particle of a rig has.

    Parameters
    ----------
    width : float
        The diameter [m].

    Returns
    -------
    str
        A sentence; empty where the diameter is possible.
    """
    if THINNEST <= width <= LARGEST_BEAD:
        return ""
    limit = f"more than {LARGEST_BEAD:g} m" if width > LARGEST_BEAD else f"less than {1e6 * THINNEST:g} um"
    return f"the particle would be {width:.3g} m wide, {limit}; check its unit."


def very_small(particle: Particle) -> str:
    """Return a remark on a particle thinner than a hair.

    Parameters
    ----------
    particle : Particle
        The particle; of sizes that differ its typical one counts.

    Returns
    -------
    str
        The remark; empty for others.
    """
    width = particle.typical.diameter
    if width >= HAIR:
        return ""
    return f"{particle.name} is {1e6 * width:.3g} um wide, thinner than a hair; check the unit of its size"


def heavier_than_its_solid(particle: Particle) -> str:
    """Return a remark on a particle that is denser than the material that it is made of.

    Parameters
    ----------
    particle : Particle
        The particle.

    Returns
    -------
    str
        The remark; empty for others.
    """
    density, solid = particle.effective_density, particle.material.density
    if density <= (1 + HEAVIER) * solid:
        return ""
    return (
        f"{particle.name} weighs {1e3 * particle.mass:.3g} g, which is {density:.4g} kg/m^3, and "
        f"{particle.material.name} has {solid:.4g} kg/m^3: holes make a particle lighter, nothing heavier; check its "
        "mass, its size and the density of the material"
    )


@dataclass(frozen=True)
class Material:
    """An isotropic elastic solid."""

    name: str
    density: float  # [kg/m^3]
    youngs_modulus: float  # [Pa]
    poisson_ratio: float  # [1]

    def __post_init__(self) -> None:
        _positive(self.name, density=self.density, youngs_modulus=self.youngs_modulus)
        if not 0 <= self.poisson_ratio < 0.5:
            raise BadInput(f"{self.name}: poisson_ratio must lie between 0 and 0.5, got {self.poisson_ratio:g}.")

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)) [Pa] (Hlosta et al. 2020, eq. 6)."""
        return self.youngs_modulus / (2 * (1 + self.poisson_ratio))

    def softened(self, factor: float) -> Material:
        """Return the same material with another stiffness.

        Parameters
        ----------
        factor : float
            Factor on Young's modulus [1].

        Returns
        -------
        Material
            The other material.

        References
        ----------
        Hlosta et al. 2020, section 2.2.3.
        """
        return replace(self, youngs_modulus=self.youngs_modulus * factor)


@dataclass(frozen=True)
class Particle:
    """A sphere of a material, or a rigid clump of overlapping spheres (`clumped` makes one).

    `density` is that of the particle itself, which may differ from the solid's (beads have holes); None takes the
    material's.  With `sizes` the particles are not alike: dimensions and mass are those of the largest, a smaller one
    is the same body shrunk, and `typical` and `mean_mass` stand for all of them.
    """

    name: str
    material: Material
    diameter: float  # [m], of the sphere; of a clump that of the sphere about its centre of mass that holds it
    density: float | None = None  # [kg/m^3], over the volume of a clump's union
    shape: Clump | None = None  # None: a sphere
    sizes: Sizes | None = None  # of diameters of a sphere, of equivalent diameters of a clump; None: all equal

    def __post_init__(self) -> None:
        _positive(self.name, diameter=self.diameter)
        if self.shape is not None and not math.isclose(self.diameter, 2 * self.shape.reach, rel_tol=1e-9):
            raise BadInput(f"{self.name}: the diameter of a clump follows from its shape; make it with clumped().")
        if self.sizes is not None and not math.isclose(self.sizes.largest, self.equivalent_diameter, rel_tol=1e-9):
            raise BadInput(f"{self.name}: the particle is the largest of its sizes; make it with sized().")
        if self.density is not None:
            _positive(self.name, density=self.density)

    @property
    def radius(self) -> float:
        """Half the diameter [m]."""
        return self.diameter / 2

    @property
    def radii(self) -> tuple[float, ...]:
        """Radii of its spheres [m]."""
        return (self.radius,) if self.shape is None else self.shape.radii

    @property
    def volume(self) -> float:
        """Volume of the largest particle [m^3]; of a clump that of the union of its spheres."""
        return math.pi / 6 * self.diameter**3 if self.shape is None else self.shape.volume

    @property
    def equivalent_diameter(self) -> float:
        """Diameter of the sphere of its volume [m]."""
        return self.diameter if self.shape is None else (6 * self.volume / math.pi) ** (1 / 3)

    @property
    def moments(self) -> tuple[float, float, float]:
        """Principal moments of inertia [kg m^2]."""
        if self.shape is None:
            return (0.4 * self.mass * self.radius**2,) * 3
        x, y, z = self.shape.gyration
        return self.mass * x, self.mass * y, self.mass * z

    @property
    def effective_density(self) -> float:
        """Density of the particle [kg/m^3], by default that of its material."""
        return self.material.density if self.density is None else self.density

    @property
    def mass(self) -> float:
        """Mass of the largest particle [kg]."""
        if self.shape is None:
            return self.effective_density * math.pi / 6 * self.diameter**3
        return self.effective_density * self.shape.volume

    @property
    def smallest_size(self) -> float:
        """Size of the smallest particle over the largest [1]."""
        return 1.0 if self.sizes is None else self.sizes.smallest / self.sizes.largest

    @property
    def smallest_radius(self) -> float:
        """Radius of the smallest sphere of the smallest particle [m]."""
        return min(self.radii) * self.smallest_size

    @property
    def mean_cube(self) -> float:
        """Mean over all particles, by number, of the cube of their size over that of the largest [1]."""
        return 1.0 if self.sizes is None else self.sizes.mean_power(3) / self.sizes.largest**3

    @property
    def mean_mass(self) -> float:
        """Mean mass over all particles, by number [kg]."""
        return self.mass * self.mean_cube

    @property
    def mean_volume(self) -> float:
        """Mean volume over all particles, by number [m^3]."""
        return self.volume * self.mean_cube

    @property
    def typical(self) -> Particle:
        """The particle of the median size by mass, for formulas that take one diameter."""
        if self.sizes is None:
            return self
        return scaled(replace(self, sizes=None), self.sizes.median_by_mass / self.sizes.largest)

    @property
    def rayleigh_time_step(self) -> float:
        """Rayleigh time step [s].

        Returns
        -------
        float
            pi R / (0.163 nu + 0.8766) sqrt(rho / G), R the radius of the smallest sphere [s].

        References
        ----------
        Hlosta et al. 2020, eq. 7.
        """
        nu = self.material.poisson_ratio
        return (
            math.pi
            * self.smallest_radius
            / (0.163 * nu + 0.8766)
            * math.sqrt(self.effective_density / self.material.shear_modulus)
        )


def clumped(
    name: str, material: Material, shape: Clump, *, density: float | None = None, mass: float | None = None
) -> Particle:
    """Return a rigid clump of spheres as a particle.

    Parameters
    ----------
    name : str
        Name of the particle.
    material : Material
        Material of all spheres.
    shape : Clump
        Spheres of the clump, with their mass properties.
    density : float, optional
        Density over the volume of the union [kg/m^3].  Default: that of the material.
    mass : float, optional
        In place of `density`: mass of the real particle [kg], which is kept whatever the volume of the clump.

    Returns
    -------
    Particle
        The particle.

    Raises
    ------
    BadInput
        If density and mass are both given, or one is not positive.

    References
    ----------
    Hlosta et al. 2020, section 2.2.2.
    """
    if mass is not None:
        if density is not None:
            raise BadInput(f"{name}: density and mass are both given; leave one of them out.")
        _positive(name, mass=mass)
        density = mass / shape.volume
    return Particle(name, material, 2 * shape.reach, density, shape)


def scaled(particle: Particle, factor: float) -> Particle:
    """Return the same body with all lengths times a factor, at the same density.

    Parameters
    ----------
    particle : Particle
        Particle to be scaled.
    factor : float
        The factor [1].

    Returns
    -------
    Particle
        The other particle.
    """
    sizes = None if particle.sizes is None else particle.sizes.scaled(factor)
    if particle.shape is None:
        return replace(particle, diameter=particle.diameter * factor, sizes=sizes)
    shape = particle.shape.scaled(factor)
    return replace(particle, diameter=2 * shape.reach, shape=shape, sizes=sizes)


def sized(particle: Particle, sizes: Sizes) -> Particle:
    """Return a particle in several sizes.

    Parameters
    ----------
    particle : Particle
        The particle, of any size.
    sizes : Sizes
        Diameters of a sphere, of a clump those of the sphere of its volume [m].

    Returns
    -------
    Particle
        The largest of the sizes.

    Examples
    --------
    >>> from rigtwin.lab.size_distributions import uniform
    >>> bead = sized(Particle("bead", Material("ash", 720, 11e9, 0.44), 6e-3), uniform(3e-3, 5e-3))
    >>> bead.diameter, round(bead.typical.diameter, 5)
    (0.005, 0.00433)
    """
    whole = scaled(replace(particle, sizes=None), sizes.largest / particle.equivalent_diameter)
    return replace(whole, sizes=sizes)


MOST_FRICTION = 10.0
"""Largest coefficient of friction that is taken; the largest of dry grains are near 1, and 36 was meant to be 0.36."""


@dataclass(frozen=True)
class Contact:
    """Interaction parameters of a pair particle-particle or particle-wall."""

    restitution: float  # [1], 0 < e <= 1
    static_friction: float = 0.0  # [1], Coulomb limit of the tangential force
    rolling_friction: float = 0.0  # [1], torque limit mu_r Fn R on each body (EDEM's convention, as in the paper)

    def __post_init__(self) -> None:
        if not 0 < self.restitution <= 1:
            raise BadInput(f"restitution must be above 0 and at most 1, got {self.restitution:g}.")
        for name in ("static_friction", "rolling_friction"):
            value = getattr(self, name)
            if not 0 <= value <= MOST_FRICTION:
                raise BadInput(
                    f"{name}: {value:g} is out of range; it must be at least 0 and at most {MOST_FRICTION:g}."
                )


Pair = tuple[str, str]
"""Names of the two sides of a contact, sorted."""

PARAMETERS = ("restitution", "static_friction", "rolling_friction")
"""The interaction parameters of a contact, by name."""


@dataclass(frozen=True)
class KnownContact:
    """What is known of a contact so far; None is "not known", never a default."""

    restitution: float | None = None  # [1]
    static_friction: float | None = None  # [1]
    rolling_friction: float | None = None  # [1]

    def missing(self, needs: Sequence[str] = PARAMETERS) -> tuple[str, ...]:
        """Return which parameters are not known.

        Parameters
        ----------
        needs : sequence of str
            The parameters that are asked for.

        Returns
        -------
        tuple of str
            Those that are not known.
        """
        return tuple(name for name in needs if getattr(self, name) is None)

    def filled(self, other: KnownContact | Contact) -> KnownContact:
        """Return this contact with its gaps filled.

        Parameters
        ----------
        other : KnownContact or Contact
            What fills them.

        Returns
        -------
        KnownContact
            The filled contact.
        """
        return KnownContact(**{name: _first(getattr(self, name), getattr(other, name)) for name in PARAMETERS})

    def complete(self, needs: Sequence[str] = PARAMETERS, *, name: str = "contact") -> Contact:
        """Return the contact to simulate with.

        Parameters
        ----------
        needs : sequence of str
            Parameters that must be known; any other that is not known is zero (restitution: one).
        name : str
            Name of the contact, for the error message.

        Returns
        -------
        Contact
            The contact.

        Raises
        ------
        TwinLacks
            If a needed parameter is not known.
        """
        if gaps := self.missing(needs):
            raise TwinLacks(f"the {gaps[0]} of the contact {name} is not known; give it under [contacts.{name}].")
        return Contact(
            restitution=_first(self.restitution, 1.0),
            static_friction=_first(self.static_friction, 0.0),
            rolling_friction=_first(self.rolling_friction, 0.0),
        )


def pair(a: str, b: str) -> Pair:
    """Return the key of a contact, the same for either order of names.

    Parameters
    ----------
    a, b : str
        Names of the two sides.

    Returns
    -------
    tuple of str
        The names, sorted.

    Examples
    --------
    >>> pair("steel", "D6")
    ('D6', 'steel')
    """
    return (a, b) if a <= b else (b, a)


def _positive(owner: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise BadInput(f"{owner}: {name} must be a positive number, got {value:g}.")


def _first(known: float | None, other: float | None) -> Any:
    return other if known is None else known
