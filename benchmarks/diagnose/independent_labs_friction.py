"""Laws of sliding and rolling friction, and of forces along a track, that an independent lab may hide."""

from __future__ import annotations

import math

from rigtwin.benchmarks.diagnose.independent_labs_types import Condition, Hidden, Lab, Make, Rng, Rolling, Sized, Slip


def ageing(kind: str) -> Make:
    """Friction that grows while a clump rests: with the logarithm of the time, or with a small power of it."""

    def make(rng: Rng, _lab: Lab) -> Sized:
        rate, power = float(rng.uniform(0.008, 0.02)), float(rng.uniform(0.08, 0.2))

        def sized(size: float) -> Hidden:
            def friction(plain: float, slip: Slip) -> float:
                grown = math.log1p(slip.waited / 1.0) if kind == "log" else ((1 + slip.waited) ** power - 1) / power
                return plain + size * rate * grown  # in a short slide the contacts keep their age

            return Hidden(friction=friction)

        return sized

    return make


def by_speed(kind: str) -> Make:
    """Kinetic friction that falls with the speed to a lower level, or changes in proportion to it."""

    def make(rng: Rng, _lab: Lab) -> Sized:
        falls, scale = float(rng.uniform(0.03, 0.08)), float(rng.uniform(0.05, 0.3))
        slope = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.1))

        def sized(size: float) -> Hidden:
            def friction(plain: float, slip: Slip) -> float:
                if kind == "weakening":
                    return plain - size * falls * (1 - math.exp(-slip.speed / scale))
                return plain + size * slope * slip.speed

            return Hidden(friction=friction)

        return sized

    return make


def by_load(kind: str) -> Make:
    """Friction that is higher under a small load: a pull of the surface, or a power of the load."""

    def make(rng: Rng, lab: Lab) -> Sized:
        lightest = 9.81 * min(condition.nominal["mass"] for condition in lab.conditions)
        share, power = float(rng.uniform(0.05, 0.2)), float(rng.uniform(0.04, 0.12))

        def sized(size: float) -> Hidden:
            def friction(plain: float, slip: Slip) -> float:
                load = max(slip.load, 1e-9)
                if kind == "adhesion":
                    return plain * (1 + size * share * lightest / load)
                return float(plain * (load / lightest) ** (-size * power))

            return Hidden(friction=friction)

        return sized

    return make


def shaken_arm(rng: Rng, _lab: Lab) -> Sized:
    """The arm's drive shakes it along its length."""
    push, period = float(rng.uniform(0.1, 0.4)), float(rng.uniform(0.1, 0.35))

    def sized(size: float) -> Hidden:
        return Hidden(along=lambda t, _s, _v, _c: size * push * math.sin(2 * math.pi * t / period))

    return sized


def patch(rng: Rng, _lab: Lab) -> Sized:
    """The surface is rougher or smoother below one place on the arm."""
    edge, step = float(rng.uniform(0.12, 0.19)), float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.06))

    def sized(size: float) -> Hidden:
        def friction(plain: float, slip: Slip) -> float:
            return plain + size * step / (1 + math.exp((slip.place - edge) / 2e-3))

        return Hidden(friction=friction)

    return sized


def rolling_by_speed(kind: str) -> Make:
    """Rolling resistance that grows in proportion to the speed, or with its root, or by a small power of it."""
    power = {"linear": 1.0, "root": 0.5, "viscoelastic": 0.2}[kind]

    def make(rng: Rng, lab: Lab) -> Sized:
        plain = lab.conditions[0].nominal["rolling"]
        growth = float(rng.uniform(0.3, 1.2)) * plain  # at 1 m/s

        def sized(size: float) -> Hidden:
            return Hidden(rolling=lambda mu, now: mu + size * growth * max(now.speed, 0.0) ** power)

        return sized

    return make


def by_direction(kind: str) -> Make:
    """Rolling resistance with and against the lay of a surface, which turns with the surface."""

    def make(rng: Rng, lab: Lab) -> Sized:
        sign, share = float(rng.choice([-1, 1])), float(rng.uniform(0.08, 0.3))
        typical = lab.conditions[0].nominal["rolling"]

        def sized(size: float) -> Hidden:
            def rolling(plain: float, now: Rolling) -> float:
                along = sign * now.way * (-1.0 if now.turned else 1.0)
                return plain + along * size * share * (plain if kind == "ratio" else typical)

            return Hidden(rolling=rolling)

        return sized

    return make


def wedge(rng: Rng, lab: Lab) -> Sized:
    """A surface thicker at one end, which slopes the other way once it is turned."""
    slope = float(rng.choice([-1, 1]) * rng.uniform(0.003, 0.02))  # [rad]

    def sized(size: float) -> Hidden:
        return Hidden(shifts={"wedge": size * slope})

    return sized


def lever(kind: str) -> Make:
    """One length instead of one coefficient per bead; the beads of the lab are drawn that way."""

    def make(rng: Rng, lab: Lab) -> Sized:
        middle = lab.spheres[len(lab.spheres) // 2]
        softer = float(rng.uniform(0.0, 0.1)) if kind == "nearly" else 0.0

        def sized(_size: float) -> Hidden:
            return Hidden(rolling=lambda mu, now: mu * (now.sphere.diameter / middle.diameter) ** softer)

        return sized

    return make


def clump_drag(kind: str) -> Make:
    """Something that brakes a clump the more the faster it slides: a film of oil, or a sail in the air."""

    def make(rng: Rng, lab: Lab) -> Sized:
        strength, power = float(rng.uniform(0.1, 0.5)), 1.0 if kind == "film" else 2.0
        return lambda size: Hidden(along=lambda _t, _s, v, _c: -size * strength * max(v, 0.0) ** power)

    return make


def ripple(rng: Rng, lab: Lab) -> Sized:
    """A track that goes up and down with the place."""
    pitch = float(rng.uniform(0.06, 0.2))
    push, phase = float(rng.uniform(0.05, 0.25)), float(rng.uniform(0, 2 * math.pi))

    def sized(size: float) -> Hidden:
        return Hidden(along=lambda _t, s, _v, _c: size * push * math.sin(2 * math.pi * s / pitch + phase))

    return sized


def sag(rng: Rng, lab: Lab) -> Sized:
    """A track whose slope changes with the place, whichever way the bead comes."""
    curve = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.1))  # [rad/m]
    return lambda size: Hidden(along=lambda _t, s, _v, c: 9.81 * size * curve * s)


def magnet_at_track(rng: Rng, lab: Lab) -> Sized:
    """A magnet under one place of the track."""
    length = lab.conditions[0].nominal["length"]
    place, width = float(rng.uniform(0.3, 0.7)) * length, float(rng.uniform(0.08, 0.2)) * length
    strength = float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.5))

    def sized(size: float) -> Hidden:
        def along(_t: float, s: float, _v: float, condition: Condition) -> float:
            u = (s - place) / width
            return -size * strength * u * math.exp(-(u**2) / 2)

        return Hidden(along=along)

    return sized
