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
    also: tuple[str, ...] = ()  # effects that no data of this rig can distinguish from it
    listed: bool = True
    fixed: bool = False  # nature sets the size; the bench must fit it
    setup: Mapping[str, Any] = field(default_factory=dict)  # what the rig needs for it
    on: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # ... and what one of its rigs needs besides
    beads: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # materials by strength, where these make it
    absorbed: bool = False  # a plain model takes it up with a number for each bead: it fits as well, but is less simple
    unseen: bool = False  # ... and the effect has no other trace


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
        also=("pivot_viscous",),  # on threads of one length, where it is the same for all beads
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
            "viscoelastic": flight.by_impact_speed(flight.kuwabara, "loss"),
            "Pade": flight.by_impact_speed(flight.pade, "loss"),
            "plastic": flight.by_impact_speed(flight.plastic, "rest"),
            "yield": flight.by_impact_speed(flight.thornton, "rest"),
        },
        ("drop", "double"),
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
        ("drop", "double"),
        ("adhesion", "cohesion", "jkr", "sticking", "stickiness", "adhesion&!contact"),
    ),
    Effect(
        "electrostatic_attraction",
        {"alike": flight.charge("alike"), "by area": flight.charge("area"), "leaking": flight.charge("leaking")},
        ("drop",),
        (
            "electrostatic",
            "electrostatic&!bead",
            "electrostatic attraction",
            "charge",
            "image charge",
            "coulomb attraction",
        ),
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
        ("drop", "pendulum", "double", "roll"),
        ("wrong frame rate", "frame rate", "frame rate error", "clock", "frame&rate&!shutter"),
    ),
    Effect(
        "scale_error",
        {"ratio": camera.shift("scale", 0.01, 0.05)},
        ("drop", "pendulum", "double"),
        ("scale error", "wrong scale", "scale", "pixel scale", "scale&error"),
    ),
    Effect(
        "camera_roll",
        {"turn": camera.shift("roll", 0.012, 0.06)},
        ("drop", "pendulum", "double"),
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
        ("drop", "roll"),
        ("plate tilt", "tilted plate", "plate level", "non-level plate", "plate&tilt", "plate&level"),
        on={"roll": {"both_ways": True}},
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
        ("pendulum", "double"),
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
        ("pendulum", "double"),
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
        also=("air_drag", "linear_drag", "pivot_viscous"),
    ),
    Effect(
        "length_error",
        {"offset": camera.shift("length", 0.003, 0.012), "ratio": camera.shift("length_ratio", 0.01, 0.04)},
        ("pendulum", "double"),
        ("length error", "wrong length", "pendulum length", "thread length", "length", "length&error"),
    ),
    Effect(
        "thread_mass",
        {
            "uniform": camera.shift("thread_mass", 2e-6, 4e-5, signed=False),
            "knot halfway": camera.shift("knot", 2e-6, 2e-5, signed=False),
        },
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
        ("contact adhesion", "adhesion", "cohesion", "load dependent friction", "friction&load", "contact&adhesion"),
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
    Effect(
        "bead_repulsion",
        {"charges": flight.repulsion("charges"), "exponential": flight.repulsion("exponential")},
        ("double",),
        ("bead repulsion", "repulsion", "bead&repulsion", "beads&repel", "coulomb repulsion", "charge&repulsion"),
    ),
    Effect(
        "off_centre_impact",
        {"fixed": camera.shift("off_centre", 0.2, 0.5, signed=False)},
        ("double",),
        ("off centre impact", "off-centre impact", "eccentric impact", "oblique impact", "off&centre"),
        absorbed=True,
        unseen=True,
    ),
    Effect(
        "rolling_speed",
        {
            "linear": friction.rolling_by_speed("linear"),
            "root": friction.rolling_by_speed("root"),
            "viscoelastic": friction.rolling_by_speed("viscoelastic"),
        },
        ("roll",),
        ("velocity dependent rolling resistance", "rolling&speed", "rolling&velocity", "rolling&viscous"),
    ),
    Effect(
        "rolling_lever",
        {"exact": friction.lever("exact"), "nearly": friction.lever("nearly")},
        ("roll",),
        ("rolling lever", "lever arm", "rolling resistance lever arm", "rolling&arm", "rolling&lever", "rolling&size"),
        absorbed=True,
        setup={"sizes": True},
    ),
    Effect(
        "surface_direction",
        {"ratio": friction.by_direction("ratio"), "difference": friction.by_direction("difference")},
        ("roll",),
        ("surface direction", "surface&direction", "grain direction", "anisotropic friction", "lay direction"),
        setup={"turned": True},
    ),
    Effect(
        "tilt_rate_error",
        {"ratio": camera.shift("rate", 0.02, 0.1)},
        ("slide",),
        ("tilt rate error", "wrong tilt rate", "tilt rate", "tilt&rate"),
    ),
    Effect(
        "surface_slope",
        {"wedge": friction.wedge},
        ("roll",),
        ("surface slope", "wedge", "surface&slope", "surface&wedge"),
        also=("surface_direction",),
        setup={"turned": True},
        on={"roll": {"pushed": True}},
    ),
    Effect(
        "sliding_speed",
        {"weakening": friction.by_speed("weakening"), "linear": friction.by_speed("linear")},
        ("slide",),
        (
            "velocity dependent friction",
            "speed dependent friction",
            "velocity weakening",
            "friction&speed",
            "friction&velocity",
            "sliding&speed",
        ),
        also=("friction_drop",),
    ),
)

UNLISTED = (
    Effect(
        "drag on the clump",
        {"film": friction.clump_drag("film"), "sail": friction.clump_drag("sail")},
        ("slide",),
        ("viscous sliding", "lubrication", "drag", "drag on the clump", "sliding&viscous", "friction&speed"),
        also=("sliding_speed",),  # at one load a viscous film is a friction that grows with the speed
        listed=False,
    ),
    Effect("ripple", {"sine": friction.ripple}, ("roll",), ("ripple", "waviness"), listed=False),
    Effect("sagging track", {"steady": friction.sag}, ("roll",), ("sag", "curved track"), listed=False),
    Effect("magnet under the track", {"bell": friction.magnet_at_track}, ("roll",), ("magnet",), listed=False),
    Effect(
        "slip at the start",
        {"pushed": camera.shift("slip", 0.5, 1.0, signed=False)},
        ("roll",),
        ("slip", "sliding start", "skid"),
        listed=False,
        setup={"pushed": True},
    ),
    Effect("breeze above a height", {"step": flight.breeze}, ("drop",), ("draught", "wind", "breeze"), listed=False),
    Effect("magnet beside the fall", {"bell": flight.magnet_beside}, ("drop",), ("magnet",), listed=False),
    Effect("magnet under the swing", {"bell": thread.magnet_below}, ("pendulum", "double"), ("magnet",), listed=False),
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
    ("pivot_friction", "camera_roll", "double"),
    ("velocity_dependent_restitution", "scale_error", "double"),
    ("rolling_speed", "plate_tilt", "roll"),
)
