"""Materials, particles and the contacts between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from rigtwin.lab.errors import BadInput


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
        """The same material with its stiffness multiplied by `factor` (Hlosta et al. 2020, section 2.2.3)."""
        return replace(self, youngs_modulus=self.youngs_modulus * factor)


@dataclass(frozen=True)
class Particle:
    """A sphere of a material.

    `density` is that of the particle itself, which may differ from the solid's (beads have holes); None takes the
    material's.
    """

    name: str
    material: Material
    diameter: float  # [m]
    density: float | None = None  # [kg/m^3]

    def __post_init__(self) -> None:
        _positive(self.name, diameter=self.diameter)
        if self.density is not None:
            _positive(self.name, density=self.density)

    @property
    def radius(self) -> float:
        """[m]"""
        return self.diameter / 2

    @property
    def effective_density(self) -> float:
        """[kg/m^3]"""
        return self.material.density if self.density is None else self.density

    @property
    def mass(self) -> float:
        """[kg]"""
        return self.effective_density * math.pi / 6 * self.diameter**3

    @property
    def rayleigh_time_step(self) -> float:
        """Rayleigh time step [s] (Hlosta et al. 2020, eq. 7).

        pi R / (0.163 nu + 0.8766) sqrt(rho / G)
        """
        nu = self.material.poisson_ratio
        return (
            math.pi
            * self.radius
            / (0.163 * nu + 0.8766)
            * math.sqrt(self.effective_density / self.material.shear_modulus)
        )


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
            if not (math.isfinite(value) and value >= 0):
                raise BadInput(f"{name} must be zero or positive, got {value:g}.")


def _positive(owner: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise BadInput(f"{owner}: {name} must be a positive number, got {value:g}.")
