"""What the beads and plates of the independent labs are made of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rigtwin.benchmarks.diagnose.independent_labs_types import Rng, Sphere

MATERIALS = {  # density from, to [kg/m^3], modulus [Pa], Poisson's ratio, restitution on a hard plate, rolling friction
    "expanded polystyrene": ("EPS", 18, 40, 5e6, 0.1, 0.70, 0.015),
    "balsa": ("BA", 110, 170, 3e9, 0.3, 0.52, 0.030),
    "cork": ("CK", 190, 260, 2e7, 0.05, 0.56, 0.030),
    "wood": ("WD", 540, 760, 1.0e10, 0.4, 0.50, 0.030),
    "polypropylene": ("PP", 895, 915, 1.4e9, 0.42, 0.72, 0.015),
    "polyamide": ("PA", 1130, 1150, 2.8e9, 0.39, 0.76, 0.012),
    "PMMA": ("PM", 1180, 1195, 3.1e9, 0.38, 0.80, 0.010),
    "glass": ("GL", 2450, 2550, 6.4e10, 0.22, 0.85, 0.006),
    "alumina": ("AL", 3750, 3900, 3.6e11, 0.22, 0.84, 0.005),
    "steel": ("ST", 7700, 7850, 2.1e11, 0.29, 0.66, 0.004),
}
AIRY = ("expanded polystyrene", "balsa", "cork")
LIGHT = ("balsa", "cork", "wood", "polypropylene")
PLASTIC = ("polypropylene", "polyamide", "PMMA", "wood")
DENSE = ("polyamide", "PMMA", "glass", "alumina", "steel")
SINKING = ("polyamide", "PMMA", "glass", "alumina", "steel")

WALLS = {  # as lab.json states them; sliding friction
    "glass": ({"density_kg_m3": 2500, "youngs_modulus_Pa": 7.0e10, "poissons_ratio": 0.22, "thickness_m": 0.012}, 0.33),
    "granite": ({"density_kg_m3": 2700, "youngs_modulus_Pa": 5e10, "poissons_ratio": 0.25, "thickness_m": 0.03}, 0.42),
    "steel": ({"density_kg_m3": 7850, "youngs_modulus_Pa": 2.1e11, "poissons_ratio": 0.3, "thickness_m": 0.02}, 0.36),
    "PMMA": ({"density_kg_m3": 1190, "youngs_modulus_Pa": 3.1e9, "poissons_ratio": 0.38, "thickness_m": 0.015}, 0.47),
}
DIAMETER_UNCERTAINTY = 2e-5  # [m], stated; real errors are half as large


def sphere(rng: Rng, materials: Sequence[str], *, least: float = 3.0, most: float = 14.0) -> Sphere:
    """A bead of one of these materials, its diameter between the limits [mm]."""
    material = str(rng.choice(list(materials)))
    short, low, high, modulus, poisson, restitution, _rolling = MATERIALS[material]
    diameter = round(float(rng.uniform(max(least, 6.0) if material in AIRY else least, most)), 1)
    return Sphere(
        f"{short}{diameter * 10:.0f}", material, diameter * 1e-3, round(float(rng.uniform(low, high))), modulus,
        poisson, restitution,
    )  # fmt: skip


def spheres(
    rng: Rng, count: int, materials: Sequence[str], *, least: float = 3.0, most: float = 14.0
) -> tuple[Sphere, ...]:
    """Beads of different names."""
    found: dict[str, Sphere] = {}
    while len(found) < count:
        one = sphere(rng, materials, least=least, most=most)
        found[one.name] = one
    return tuple(found.values())


def distinct(beads: Iterable[Sphere]) -> tuple[Sphere, ...]:
    """One bead of each name: beads of nearly the same size share it."""
    return tuple({bead.name: bead for bead in beads}.values())


def wall(rng: Rng) -> str:
    return str(rng.choice(list(WALLS)))
