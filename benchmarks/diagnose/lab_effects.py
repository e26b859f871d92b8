"""The effects that may be hidden in a lab: names, sizes near the detection limit and above, and where they show.

`sizes` are (weak, moderate, strong) in the units of the number in `World.hidden`.  For a lab of the size drawn here
weak means about 5 to 20 standard errors once everything that a lab may be wrong about is free, moderate 20 to 80,
strong more.  Air drag and buoyancy keep their real size: there the beads make the strength.  Where the plate bends the
beads make it too, but its loss is exaggerated: 6 to 12 times that of a wide, free plate of the stated thickness, as one
of 0.3 to 0.4 of it would have.  No more is lost to it than a bead has, and its strong labs are not beyond 80.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

STRENGTHS = ("weak", "moderate", "strong")
RIGS = ("drop", "pendulum", "double", "slide", "roll")  # "pendulum" with or without a wall

# beads by how much the air does to them
LIGHT, MIDDLE, HEAVY = ("EPS12", "D4"), ("D6", "ABS6"), ("ST5", "GL6", "ABS10")


@dataclass(frozen=True)
class Effect:
    """One thing that the baseline model lacks, or that the measurement does wrong."""

    name: str
    synonyms: tuple[str, ...]  # "a&b&!c": has the words a and b and not c
    number: str  # in World.hidden
    sizes: Mapping[str, tuple[float, float, float]]  # by rig
    where: str
    more: Mapping[str, float] = field(default_factory=dict)  # further numbers that come with it
    beads: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by strength, where the beads make it
    signed: bool = False  # the sign is drawn
    also: tuple[str, ...] = ()  # names for the same physics, or for what no data of these rigs could tell from it
    unseen: bool = False  # a baseline with one number per bead and wall takes it up without a trace
    wall_only: bool = False  # among pendulums, needs one that strikes a wall
    listed: bool = True
    terms: tuple[tuple[str, ...], ...] = ()
    """Sets of terms of a formula, any of which is right, of an effect that is not listed: its own form, and what is
    the same within the range that a lab sees."""
    weak_terms: tuple[tuple[str, ...], ...] = ()
    """... and what data cannot tell from them where the effect is weak."""
    shape: Mapping[str, float] = field(default_factory=dict)
    """True numbers of the shape of those terms, by the name that a formula gives them."""


def _by_rig(**sizes: tuple[float, float, float]) -> dict[str, tuple[float, float, float]]:
    return sizes


BY_BEAD = {"weak": HEAVY, "moderate": MIDDLE, "strong": LIGHT}

LISTED = (
    Effect(
        "air_drag",
        ("air drag", "aerodynamic drag", "quadratic drag", "air resistance", "schiller naumann", "drag", "air&drag"),
        "kd",
        _by_rig(drop=(0.55, 0.55, 0.55), pendulum=(0.55, 0.55, 0.55), double=(0.55, 0.55, 0.55), roll=(0.55,) * 3),
        "fall and swing lose speed with speed; light and small beads more",
        beads=BY_BEAD,
    ),
    Effect(
        "linear_drag",
        ("linear drag", "stokes drag", "viscous drag", "linear air drag", "viscous&drag", "linear&drag"),
        "linear_drag",  # [N s/m^2], per diameter
        _by_rig(drop=(1e-4, 3e-4, 1.5e-3), pendulum=(3e-6, 1.5e-5, 2e-4)),
        "as air drag, but in proportion to the speed",
    ),
    Effect(
        "buoyancy",
        ("buoyancy", "buoyancy and added mass", "added mass", "archimedes", "buoyant", "displaced air"),
        "fluid_density",
        _by_rig(drop=(1.2, 1.2, 1.2), pendulum=(1.2, 1.2, 1.2)),
        "a constant part of the weight is missing; light beads alone",
        beads={"weak": ("D4", "D6"), "moderate": ("BL10",), "strong": ("EPS12",)},
    ),
    Effect(
        "velocity_dependent_restitution",
        (
            "velocity dependent restitution",
            "speed dependent restitution",
            "viscoelastic restitution",
            "viscoelastic",
            "plastic restitution",
            "elastic plastic",
            "e of v",
            "restitution&velocity",
            "restitution&speed",
            "restitution&viscoelastic",
            "restitution&plastic",
        ),
        "fvisc",
        _by_rig(drop=(0.25, 0.6, 1.0), pendulum=(0.4, 0.7, 1.0)),
        "restitution against impact speed, over all bounces and heights; the flights themselves fit",
        wall_only=True,
    ),
    Effect(
        "plastic_restitution",
        (
            "elastic plastic restitution",
            "plastic restitution",
            "plastic impact",
            "yield",
            "plastic deformation",
            "velocity dependent restitution",
            "velocity_dependent_restitution",
            "restitution&velocity",
            "restitution&plastic",
            "restitution&viscoelastic",
            "plastic",
        ),
        "yield_speed",  # [m/s], the lower the stronger
        _by_rig(drop=(3.2, 2.2, 0.7), pendulum=(1.2, 0.8, 0.3)),
        "restitution falls as v^(-1/4) above a yield speed",
        also=("velocity_dependent_restitution",),
        wall_only=True,
    ),
    Effect(
        "adhesion",
        ("adhesion", "cohesion", "jkr", "sjkr", "capillary bridge", "liquid bridge", "sticking", "stickiness"),
        "bond",  # [J/m], energy of one detachment per radius
        _by_rig(drop=(1.5e-4, 5e-4, 1.2e-3), pendulum=(2e-5, 8e-5, 3e-4)),
        "late, slow impacts lose more than fast ones, down to sticking",
        wall_only=True,
    ),
    Effect(
        "contact_adhesion",
        ("adhesion", "cohesion", "jkr", "sjkr", "capillary bridge", "electrostatic attraction", "sticking"),
        "pull_off",  # [N]
        _by_rig(slide=(1.5e-4, 4e-4, 1.5e-3)),
        "light clumps hold on to steeper angles than heavy ones",
        also=("adhesion", "electrostatic_attraction"),
    ),
    Effect(
        "electrostatic_attraction",
        ("electrostatic attraction", "electrostatic", "charge", "image charge", "coulomb attraction", "triboelectric"),
        "charge",  # [C]
        _by_rig(drop=(5e-10, 1e-9, 2.5e-9)),
        "the bead is pulled towards the plate in the last millimetres; late rebounds are low",
    ),
    Effect(
        "plate_compliance",
        (
            "plate compliance",
            "plate vibration",
            "flexural",
            "zener",
            "compliant plate",
            "plate bending",
            "wall compliance",
        ),
        "plate_loss",  # times what a wide, free plate of the stated thickness takes, about 1 in a real lab
        _by_rig(drop=(6.0, 6.0, 12.0)),
        "restitution falls with (R/h)^2 v^(1/5): large, dense and fast beads on a thin plate",
        beads={"weak": ("GL6", "ST5"), "moderate": ("D12",), "strong": ("D12",)},
    ),
    Effect(
        "release_spin",
        ("release spin", "initial spin", "spin at release", "spin", "rotation at release"),
        "release_spin",  # [rad/s]
        _by_rig(drop=(12.0, 30.0, 80.0)),
        "a sideways kick of one sign at the first bounce only",
        signed=True,
    ),
    Effect(
        "pivot_friction",
        (
            "pivot friction",
            "coulomb pivot",
            "dry pivot friction",
            "coulomb friction at pivot",
            "hinge friction",
            "bearing friction",
            "coulomb damping",
            "pivot&coulomb",
            "pivot&dry",
        ),
        "tau_c",  # [N m]
        _by_rig(pendulum=(4e-9, 3e-8, 1e-6), double=(1e-7, 5e-7, 4e-6)),
        "the amplitude falls by a constant step per swing, light bobs more",
    ),
    Effect(
        "pivot_viscous",
        ("pivot viscous damping", "viscous pivot", "linear damping", "viscous damping", "pivot&viscous"),
        "c_pivot",  # [N m s]
        _by_rig(pendulum=(1.5e-9, 1e-8, 4e-7), double=(1e-7, 4e-7, 2e-6)),
        "exponential decay, alike at all amplitudes",
    ),
    Effect(
        "thread_mass",
        ("string mass", "thread mass", "rod mass", "massive thread", "string&mass", "thread&mass", "rod&mass"),
        "thread_density",  # [kg/m]
        _by_rig(pendulum=(2e-7, 1e-6, 3e-5)),
        "the period is short for light bobs, the radius is right",
    ),
    Effect(
        "length_error",
        ("length error", "pendulum length", "wrong length", "string length", "rod length", "thread length", "length"),
        "length_error",  # [m]
        _by_rig(pendulum=(0.0025, 0.005, 0.012), double=(0.003, 0.006, 0.012)),
        "period and tracked radius agree on another length than the stated one",
        signed=True,
    ),
    Effect(
        "friction_drop",
        (
            "static kinetic friction drop",
            "kinetic friction",
            "static kinetic",
            "stick slip",
            "friction drop",
            "static&kinetic",
            "kinetic&friction",
        ),
        "friction_drop",
        _by_rig(slide=(0.003, 0.02, 0.15)),
        "the clump starts with a jump of its acceleration",
    ),
    Effect(
        "rolling_growth",
        (
            "velocity dependent rolling resistance",
            "speed dependent rolling",
            "rolling resistance grows with speed",
            "viscous rolling",
            "rolling&velocity",
            "rolling&speed",
            "rolling&viscous",
        ),
        "rolling_growth",  # [s/m]
        _by_rig(roll=(0.001, 0.005, 0.05)),
        "the acceleration falls with speed, alike for all beads",
    ),
    Effect(
        "lever_arm",
        (
            "rolling resistance lever arm",
            "lever arm",
            "rolling lever",
            "mu_r inverse diameter",
            "rolling&arm",
            "rolling&size",
        ),
        "lever_arm",  # [m]
        _by_rig(roll=(5e-5, 1e-4, 2.7e-4)),
        "rolling friction in inverse proportion to the diameter",
    ),
    Effect(
        "off_centre_impact",
        ("off centre impact", "off-centre impact", "eccentric impact", "oblique impact", "off centre", "off&centre"),
        "off_centre",  # of a diameter
        _by_rig(double=(0.2, 0.35, 0.55)),
        "B too slow and A too fast: in the plane it looks like a lower restitution",
        unseen=True,
    ),
    Effect(
        "odd_shape",
        (
            "non-spherical impact",
            "non spherical",
            "off centre impact",
            "non-sphericity",
            "irregular shape",
            "asphericity",
            "shape",
        ),
        "odd_shape",  # [rad]
        _by_rig(drop=(0.015, 0.04, 0.15)),
        "rebounds scatter in direction and height far more than those of a sphere",
    ),
    Effect(
        "plate_tilt",
        (
            "non-level plate",
            "plate tilt",
            "base tilt",
            "tilted plate",
            "plate level",
            "level",
            "inclined plate",
            "non level",
            "plate&tilt",
            "plate&level",
        ),
        "plate_tilt",  # [rad]
        _by_rig(drop=(0.006, 0.014, 0.045), roll=(0.006, 0.025, 0.06)),
        "every rebound drifts to the same side, more with each bounce; the fall itself is straight",
        signed=True,
    ),
    Effect(
        "ageing",
        ("dwell time ageing", "ageing", "aging", "contact ageing", "dwell time", "frictional ageing", "rate and state"),
        "ageing",  # per e-fold of the waiting time
        _by_rig(slide=(0.003, 0.008, 0.025)),
        "the angle rises with the logarithm of the waiting time",
    ),
    Effect(
        "scale_error",
        ("scale error", "wrong scale", "pixel scale", "calibration scale", "scale", "length scale", "scale&error"),
        "scale",
        _by_rig(drop=(0.006, 0.015, 0.04), pendulum=(0.008, 0.02, 0.05), double=(0.008, 0.02, 0.05)),
        "all lengths off by one factor",
        signed=True,
    ),
    Effect(
        "wrong_frame_rate",
        (
            "wrong frame rate",
            "frame rate",
            "frame rate error",
            "fps",
            "clock",
            "time base",
            "time scale",
            "frame&rate&!shutter",
        ),
        "cam_q",  # added to 1
        _by_rig(
            drop=(0.0015, 0.004, 0.015),
            pendulum=(0.002, 0.006, 0.02),
            double=(0.003, 0.01, 0.03),
            roll=(0.01, 0.03, 0.08),
        ),
        "apparent gravity off by the square of the rate ratio, lengths right",
        signed=True,
    ),
    Effect(
        "camera_roll",
        ("camera roll", "roll", "tilted camera", "camera tilt", "rotated camera", "camera&roll", "camera&tilt"),
        "roll",  # [rad]
        _by_rig(drop=(0.009, 0.02, 0.055), pendulum=(0.012, 0.025, 0.06), double=(0.012, 0.025, 0.06)),
        "the whole picture is turned: the fall drifts, the swing is lopsided",
        signed=True,
    ),
    Effect(
        "perspective",
        ("perspective", "out of plane motion", "camera pitch", "out-of-plane", "keystone", "foreshortening"),
        "perspective",  # [1/m], relative growth of the scale with height
        _by_rig(drop=(0.01, 0.03, 0.12), pendulum=(0.005, 0.02, 0.08)),
        "the scale grows with height",
        signed=True,
    ),
    Effect(
        "rolling_shutter",
        ("rolling shutter", "shutter", "line readout", "row readout"),
        "shutter",  # [s/m]
        _by_rig(drop=(0.0008, 0.0025, 0.01), pendulum=(0.0004, 0.0015, 0.01)),
        "each row of the picture has its own time: odd in the speed",
    ),
    Effect(
        "timestamp_jitter",
        ("timestamp jitter", "jitter", "irregular frames", "time jitter", "frame timing", "dropped frames"),
        "jitter",  # [s]
        _by_rig(drop=(2.5e-5, 6e-5, 4e-4), pendulum=(4e-5, 1e-4, 6e-4)),
        "scatter along the path that grows with the speed",
    ),
    Effect(
        "lubricated_sliding",
        ("sliding&speed", "velocity dependent friction", "viscous sliding", "lubrication"),
        "viscous_sliding",  # [1/s]
        _by_rig(slide=(0.05, 0.2, 1.0)),
        "a drag that grows with the sliding speed: at one load a friction that does",
    ),
)

UNLISTED = (
    Effect(
        "magnetic_pull", ("magnetic", "magnet", "attraction"), "magnet",  # [m/s^2]
        _by_rig(drop=(0.1, 0.3, 1.2)), "a pull that decays over some centimetres above the plate",
        more={"magnet_reach": 0.04}, listed=False, also=("electrostatic_attraction",),
        terms=(("exp(-z / reach)",),), weak_terms=(("exp(-z / 20 mm)",), ("exp(-z / 80 mm)",)), shape={"reach": 0.04},
    ),
    Effect(
        "lift", ("magnus", "lift"), "lift",  # [1/s]
        _by_rig(drop=(0.01, 0.03, 0.1)), "a sideways force in proportion to the speed, in flight", listed=False,
        terms=(("e_z x v",),),
    ),
    Effect(
        "draught", ("wind", "draught", "side wind"), "wind",  # [m/s^2]
        _by_rig(drop=(0.05, 0.15, 0.5)), "a sideways force in one band of heights",
        more={"wind_low": 0.05, "wind_high": 0.4}, signed=True, listed=False,
        terms=(("e_x where low < z < high",),), shape={"low": 0.05, "high": 0.4},
    ),
    Effect(
        "amplitude_damping", ("theta^2 theta'", "nonlinear damping"), "odd_damping",  # [1/s]
        _by_rig(pendulum=(0.002, 0.01, 0.15)), "damping in proportion to theta^2 theta'", listed=False,
        terms=(("a^2 w",),),
    ),
    Effect(
        "hardening", ("torsion", "nonlinear stiffness"), "torsion_cubed",  # [rad/s^2]
        _by_rig(pendulum=(0.01, 0.05, 0.8)), "a restoring torque in proportion to theta^3", listed=False,
        terms=(("a^3",),),
    ),
    Effect(
        "periodic_draught", ("periodic force", "periodic wind"), "draught",  # [m/s^2]
        _by_rig(pendulum=(0.002, 0.008, 0.05)), "a sideways push that comes and goes with a period of its own",
        more={"draught_period": 0.73}, listed=False,
        terms=(("sin(2 pi t / period) + d cos(2 pi t / period)",),), shape={"period": 0.73},
    ),
    Effect(
        "vibrating_arm", ("vibration",), "vibration",
        _by_rig(slide=(0.02, 0.06, 0.2)), "the normal force swings at 3 Hz", listed=False,
        # on arms of one friction a normal force that swings is a force along the arm that does
        terms=(("sin(2 pi t / period) + d cos(2 pi t / period)",),), shape={"period": 1 / 3},
    ),
    Effect(
        "rippled_track", ("ripple", "waviness"), "ripple",  # [m/s^2]
        _by_rig(roll=(0.03, 0.1, 0.3)), "a force that goes up and down with the place, every 20 cm", listed=False,
        terms=(("sin(2 pi s / period) + d cos(2 pi s / period)",),), shape={"period": 0.2},
    ),
    Effect(
        "sagging_track", ("sag", "curved plate"), "sag",  # [rad/m]
        _by_rig(roll=(0.005, 0.02, 0.1)), "a slope that grows along the track", listed=False,
        # the slope of a sine is its angle
        terms=(("s",),),
    ),
)  # fmt: skip

ALL = {effect.name: effect for effect in (*LISTED, *UNLISTED)}

# two at once, in rigs where both act and neither hides the other
PAIRS = (
    ("air_drag", "wrong_frame_rate", "drop"), ("air_drag", "velocity_dependent_restitution", "drop"),
    ("air_drag", "plate_tilt", "drop"), ("velocity_dependent_restitution", "scale_error", "drop"),
    ("velocity_dependent_restitution", "camera_roll", "drop"), ("buoyancy", "plate_tilt", "drop"),
    ("wrong_frame_rate", "plate_tilt", "drop"), ("adhesion", "wrong_frame_rate", "drop"),
    ("air_drag", "pivot_friction", "pendulum"), ("pivot_viscous", "length_error", "pendulum"),
    ("pivot_friction", "scale_error", "pendulum"), ("air_drag", "wrong_frame_rate", "pendulum"),
    ("pivot_friction", "camera_roll", "double"), ("friction_drop", "ageing", "slide"),
    ("rolling_growth", "plate_tilt", "roll"),
)  # fmt: skip

# one at a time, in rigs where a lab of one condition often cannot tell it from another
CONFOUNDED = (
    ("plate_tilt", "roll"), ("adhesion", "wall pendulum"), ("pivot_viscous", "pendulum"), ("air_drag", "drop"),
    ("rolling_growth", "roll"), ("velocity_dependent_restitution", "wall pendulum"), ("pivot_friction", "pendulum"),
    ("linear_drag", "drop"), ("air_drag", "roll"), ("rolling_shutter", "drop"), ("plate_compliance", "drop"),
    ("adhesion", "drop"), ("linear_drag", "pendulum"), ("electrostatic_attraction", "drop"),
)  # fmt: skip
