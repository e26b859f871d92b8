"""What the independent labs hide: each effect by two laws or more, one of which is drawn for a lab."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rigtwin.benchmarks.diagnose import independent_labs_camera as camera
from rigtwin.benchmarks.diagnose import independent_labs_flight as flight
from rigtwin.benchmarks.diagnose import independent_labs_friction as friction
from rigtwin.benchmarks.diagnose import independent_labs_thread as thread
from rigtwin.benchmarks.diagnose.independent_labs_fluids import brown_lawler, schiller_naumann
from rigtwin.benchmarks.diagnose.independent_labs_spheres import AIRY, DENSE, LIGHT, SINKING
from rigtwin.benchmarks.diagnose.independent_labs_types import Make


@dataclass(frozen=True)
class Effect:
    """Something that a lab may hide."""

    name: str
    laws: Mapping[str, Make]
    rigs: tuple[str, ...]
    synonyms: tuple[str, ...]  # "a&b&!c": has the words a and b and not c
    also: tuple[str, ...] = ()  # what no data of the rig could tell from it
    listed: bool = True
    fixed: bool = False  # nature sets the size; the bench must fit it
    setup: Mapping[str, Any] = field(default_factory=dict)  # what the rig needs for it
    beads: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # materials by strength, where these make it


LISTED = (
    Effect(
        "air_drag",
        {
            "Schiller-Naumann": flight.drag(schiller_naumann),
            "constant": flight.drag(None),
            "Brown-Lawler": flight.drag(brown_lawler),
        },
        ("drop", "pendulum", "double", "roll"),
        ("air drag", "aerodynamic drag", "drag", "air resistance", "air&drag", "quadratic&drag", "schiller&naumann"),
        fixed=True,
        beads={"near": DENSE, "moderate": ("PMMA", "glass", *LIGHT[2:]), "strong": LIGHT},
    ),
    Effect(
        "linear_drag",
        {"by diameter": flight.slow_drag(1.0), "alike": flight.slow_drag(0.0)},
        ("drop", "pendulum"),
        ("linear drag", "stokes drag", "viscous drag", "linear&drag", "viscous&drag", "stokes&drag"),
    ),
    Effect(
        "buoyancy",
        {"air": flight.buoyancy},
        ("drop",),
        ("buoyancy", "added mass", "archimedes", "buoyancy&mass", "displaced&air"),
        also=("fluid",),
        fixed=True,
        beads={"near": LIGHT[1:], "moderate": LIGHT, "strong": AIRY[:1]},
    ),
    Effect(
        "fluid",
        {"water": flight.water, "oil": flight.oil},
        ("drop",),
        ("fluid", "liquid", "water", "oil", "surrounding fluid", "fluid&drag", "fluid&buoyancy", "liquid&drag"),
        fixed=True,
        setup={"materials": SINKING, "wet": 1000.0},
    ),
    Effect(
        "velocity_dependent_restitution",
        {
            "viscoelastic": flight.by_impact_speed(flight.kuwabara),
            "Pade": flight.by_impact_speed(flight.pade),
            "plastic": flight.by_impact_speed(flight.plastic),
            "yield": flight.by_impact_speed(flight.thornton),
        },
        ("drop",),
        (
            "velocity dependent restitution",
            "speed dependent restitution",
            "viscoelastic",
            "plastic",
            "yield",
            "restitution&velocity",
            "restitution&speed",
            "restitution&viscoelastic",
            "restitution&plastic",
        ),
    ),
    Effect(
        "adhesion",
        {"JKR": flight.energy_loss(4 / 3), "DMT": flight.energy_loss(1.0), "alike": flight.energy_loss(0.0)},
        ("drop",),
        ("adhesion", "cohesion", "jkr", "sticking", "stickiness", "adhesion&jkr", "adhesion&energy"),
    ),
    Effect(
        "electrostatic_attraction",
        {"alike": flight.charge("alike"), "by area": flight.charge("area"), "leaking": flight.charge("leaking")},
        ("drop",),
        ("electrostatic", "electrostatic attraction", "charge", "image charge", "coulomb attraction"),
    ),
    Effect(
        "side_attraction",
        {
            "exponential": flight.sheet(lambda d, reach: math.exp(-d / reach)),
            "inverse square": flight.sheet(lambda d, reach: (reach / d) ** 2),
        },
        ("drop",),
        (
            "side attraction",
            "side_attraction",
            "side&attraction",
            "side&repulsion",
            "sideways&attraction",
            "sheet&side",
        ),
    ),
    Effect(
        "wrong_frame_rate",
        {"any ratio": camera.shift("clock", 0.005, 0.05), "usual ratio": camera.other_clock},
        ("drop", "pendulum"),
        ("wrong frame rate", "frame rate", "frame rate error", "clock", "frame&rate&!shutter"),
    ),
    Effect(
        "scale_error",
        {"ratio": camera.shift("scale", 0.01, 0.05)},
        ("drop", "pendulum"),
        ("scale error", "wrong scale", "scale", "pixel scale", "scale&error"),
    ),
    Effect(
        "camera_roll",
        {"turn": camera.shift("roll", 0.012, 0.06)},
        ("drop", "pendulum"),
        ("camera roll", "roll", "tilted camera", "camera&roll", "camera&tilt"),
    ),
    Effect(
        "perspective",
        {"pinhole": camera.pinhole, "gradient": camera.gradient},
        ("drop", "pendulum"),
        ("perspective", "camera pitch", "keystone", "foreshortening", "out of plane"),
    ),
    Effect(
        "rolling_shutter",
        {"from below": camera.shutter(1.0), "from above": camera.shutter(-1.0)},
        ("drop", "pendulum"),
        ("rolling shutter", "shutter", "line readout", "row readout", "rolling&shutter"),
    ),
    Effect(
        "plate_tilt",
        {"leaning": camera.shift("level", 0.01, 0.05)},
        ("drop",),
        ("plate tilt", "tilted plate", "plate level", "non-level plate", "plate&tilt", "plate&level"),
    ),
    Effect(
        "release_speed",
        {"pushed": camera.shift("release_speed", 0.04, 0.2)},
        ("drop",),
        ("release speed", "release velocity", "initial velocity", "release&speed", "release&velocity"),
    ),
    Effect(
        "pivot_friction",
        {"constant": thread.moment(thread.dry, 1e-3, 2e-2), "by load": thread.moment(thread.dry_by_load, 1e-3, 2e-2)},
        ("pendulum",),
        (
            "pivot friction",
            "dry pivot friction",
            "hinge friction",
            "bearing friction",
            "coulomb damping",
            "pivot&friction&!viscous",
            "pivot&dry",
            "pivot&coulomb",
        ),
    ),
    Effect(
        "pivot_viscous",
        {"linear": thread.moment(thread.viscous, 2e-3, 4e-2), "bearing": thread.moment(thread.bearing, 2e-3, 4e-2)},
        ("pendulum",),
        ("pivot viscous", "viscous pivot friction", "linear damping", "viscous damping", "pivot&viscous"),
    ),
    Effect(
        "thread_stretch",
        {"elastic": thread.stretch, "creeping": thread.creep},
        ("pendulum",),
        ("thread stretch", "elastic thread", "creep", "thread&stretch", "string&stretch", "thread&creep"),
    ),
    Effect(
        "thread_drag",
        {"thick": thread.thread_drag(True), "thin": thread.thread_drag(False)},
        ("pendulum",),
        ("thread drag", "string drag", "thread&drag"),
        also=("air_drag", "linear_drag"),
    ),
    Effect(
        "length_error",
        {"offset": camera.shift("length", 0.003, 0.012), "ratio": camera.shift("length_ratio", 0.01, 0.04)},
        ("pendulum",),
        ("length error", "wrong length", "pendulum length", "thread length", "length"),
    ),
    Effect(
        "thread_mass",
        {"uniform": camera.shift("thread_mass", 2e-6, 4e-5, signed=False)},
        ("pendulum",),
        ("thread mass", "rod mass", "string mass", "massive thread", "rod&mass", "thread&mass", "string&mass"),
    ),
    Effect(
        "ageing",
        {"logarithm": friction.ageing("log"), "power": friction.ageing("power")},
        ("slide",),
        ("ageing", "aging", "dwell time", "contact ageing", "rate and state", "time dependent friction"),
        setup={"waits": True},
    ),
    Effect(
        "contact_adhesion",
        {"pull": friction.by_load("adhesion"), "power": friction.by_load("power")},
        ("slide",),
        ("contact adhesion", "adhesion", "cohesion", "load dependent friction", "friction&load"),
        setup={"loads": True},
    ),
    Effect(
        "friction_drop",
        {
            "difference": camera.shift("friction_drop", 0.02, 0.08, signed=False),
            "ratio": camera.shift("friction_drop_ratio", 0.05, 0.2, signed=False),
        },
        ("slide",),
        ("friction drop", "static kinetic friction drop", "kinetic friction", "static&kinetic", "kinetic&friction"),
    ),
)

UNLISTED = (
    Effect("breeze above a height", {"step": flight.breeze}, ("drop",), ("draught", "wind", "breeze"), listed=False),
    Effect("magnet beside the fall", {"bell": flight.magnet_beside}, ("drop",), ("magnet",), listed=False),
    Effect("magnet under the swing", {"bell": thread.magnet_below}, ("pendulum",), ("magnet",), listed=False),
    Effect(
        "damping by angle squared", {"odd": thread.odd_damping}, ("pendulum",), ("nonlinear damping",), listed=False
    ),
    Effect(
        "moving support",
        {"sine": thread.shaken_pivot},
        ("pendulum",),
        ("moving support", "vibrating support"),
        listed=False,
    ),
    Effect("shaken arm", {"sine": friction.shaken_arm}, ("slide",), ("vibration",), listed=False),
    Effect("patch on the arm", {"step": friction.patch}, ("slide",), ("step in friction",), listed=False),
    Effect(
        "friction by speed",
        {"weakening": friction.by_speed("weakening"), "linear": friction.by_speed("linear")},
        ("slide",),
        (
            "velocity dependent friction",
            "speed dependent friction",
            "velocity weakening",
            "friction&speed",
            "friction&velocity",
        ),
        also=("friction_drop",),
        listed=False,
    ),
    Effect(
        "wrong tilt rate",
        {"ratio": camera.shift("rate", 0.02, 0.1)},
        ("slide",),
        ("tilt rate", "tilt&rate"),
        listed=False,
    ),
)

ALL = {effect.name: effect for effect in (*LISTED, *UNLISTED)}

PAIRS: Sequence[tuple[str, str, str]] = (
    ("air_drag", "wrong_frame_rate", "drop"),
    ("air_drag", "perspective", "drop"),
    ("velocity_dependent_restitution", "plate_tilt", "drop"),
    ("air_drag", "velocity_dependent_restitution", "drop"),
    ("adhesion", "scale_error", "drop"),
    ("pivot_friction", "air_drag", "pendulum"),
    ("air_drag", "wrong_frame_rate", "pendulum"),
    ("pivot_viscous", "camera_roll", "pendulum"),
    ("friction_drop", "ageing", "slide"),
)
