"""Numbers and names as a person reads them: ``0.443 ± 0.006``, ``298.4 ± 0.5 mm``, "Rebound height, bounce 1".

The one place where a quantity has its name for people: tables, reports and overlays take it from here.  Light on
purpose: the command line prints with it before anything heavy is loaded.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

TITLES = {
    "restitution_wall": "Restitution on the wall",
    "restitution_pair": "Restitution of the pair",
    "energy_ratio_root": "√(h_B/h_A), which is (1+e)/2",
    "drop_height": "Drop height",
    "rebound_height": "Rebound height",
    "release_angle": "Release angle",
    "rebound_angle": "Rebound angle",
    "static_friction": "Static friction",
    "static_friction_angle": "Angle of static friction",
    "rolling_friction": "Rolling friction",
    "rolling_friction_angle": "Angle of rolling friction",
    "kinetic_friction": "Kinetic friction",
    "plate_angle": "Angle of the plate",
    "onset_time": "Time of the onset",
    "bed_height": "Bed height",
    "bed_height_deviation": "Deviation of the bed height",
    "bulk_density": "Bulk density",
    "angle_of_repose": "Angle of repose",
    "angle_of_repose_graphical": "Angle of repose, graphical",
    "angle_of_repose_geometric": "Angle of repose, geometric",
    "angle_of_repose_upper": "Angle of repose, upper part of the surface",
    "angle_of_repose_lower": "Angle of repose, lower part of the surface",
    "pile_height": "Height of the heap",
    "pile_base_width": "Width of the heap at its base",
    "pile_tip_radius": "Radius of the heap's tip",
    "mixing_index": "Mixing index",
    "avalanche_frequency": "Avalanches per second",
    "avalanche_start_angle": "Angle at which avalanches start",
    "avalanche_stop_angle": "Angle at which avalanches stop",
    "opening_time": "Time of the opening",
    "last_particle_time": "Time of the last particle",
    "discharge_time": "Discharge time",
    "discharge_time_5_95": "Discharge time of the middle 90 %",
    "mass_flow_rate": "Mass flow rate",
    "mass_flow": "Mass flow rate",
    "steady_mass_flow": "Mass flow rate, steady",
    "emptied_particles": "Particles that left in time",
    "particle_flow_rate": "Particles per second",
    "discharged_fraction_rate": "Share of the filling that leaves per second",
    "outlet_velocity": "Velocity at the outlet",
    "residue_fraction": "Share of the filling left behind",
    "particles_inside": "Particles in a region",
    "mass_inside": "Mass in a region",
    "particles_discharged": "Discharged particles",
    "mass_discharged": "Discharged mass",
    "rayleigh_time_step": "Rayleigh's time step",
    "seconds_per_particle": "Computing time per particle",
}

# how a unit is shown: the factor from SI and the sign behind the number
_SHOWN = {
    "1": (1.0, ""),
    "m": (1e3, "mm"),
    "deg": (1.0, "°"),
    "rad": (180 / math.pi, "°"),
    "kg": (1e3, "g"),
    "m/s^2": (1.0, "m/s²"),
    "kg/m^3": (1.0, "kg/m³"),
    "kg/s": (1e3, "g/s"),
}


def shown(unit: str) -> tuple[float, str]:
    """Return how numbers in a unit are shown.

    Parameters
    ----------
    unit : str
        SI unit.

    Returns
    -------
    factor : float
        By which a number is multiplied to be shown.
    sign : str
        Sign of its unit then.

    Examples
    --------
    >>> shown("m"), shown("s")
    ((1000.0, 'mm'), (1.0, 's'))
    """
    return _SHOWN.get(unit, (1.0, unit))


def title(quantity: str) -> str:
    """Return a quantity's name for a person.

    Parameters
    ----------
    quantity : str
        Name of the quantity.

    Returns
    -------
    str
        One of `TITLES`, else the name in words.

    Examples
    --------
    >>> title("rebound_height"), title("impact_speed")
    ('Rebound height', 'Impact speed')
    """
    return TITLES.get(quantity, quantity.replace("_", " ").capitalize())


def siblings(detail: Mapping[str, object]) -> str:
    """Return in words the details that distinguish a quantity from others of its name.

    Parameters
    ----------
    detail : mapping of str to object
        Details of the quantity.

    Returns
    -------
    str
        Empty where there are none.

    Examples
    --------
    >>> siblings({"bounce": 1}), siblings({"body": "B"}), siblings({"side": "mean", "view": "all"})
    ('bounce 1', 'bead B', 'mean, all views')
    """
    words = {"bounce": "bounce {}", "collision": "collision {}", "body": "bead {}", "side": "{}", "view": "view {}"}
    words["region"] = "{}"
    if detail.get("view") == "all":
        words["view"] = "all views"
    return ", ".join(form.format(detail[name]) for name, form in words.items() if detail.get(name) is not None)


def reading(value: float | None, std_uncertainty: float | None, unit: str) -> str:
    """Return a value with one standard uncertainty, rounded to the uncertainty's second digit.

    Decimals end at the value's fifth digit; a smaller uncertainty is shown as one unit of the last place.

    Parameters
    ----------
    value : float or None
        The value, in `unit`.
    std_uncertainty : float or None
        Its standard uncertainty, in `unit`.
    unit : str
        SI unit.

    Returns
    -------
    str
        The text, with the unit as it is `shown`.

    Examples
    --------
    >>> reading(0.44321, 0.0061, "1")
    '0.4432 ± 0.0061'
    >>> reading(0.2984, 0.0005, "m")
    '298.40 ± 0.50 mm'
    >>> reading(0.7299937, 0.0000013, "1")
    '0.72999 ± 0.00001'
    >>> reading(None, None, "deg")
    '–'
    """
    if value is None or not math.isfinite(value):
        return "–"
    factor, sign = shown(unit)
    value *= factor
    space = "" if sign in ("", "°") else " "
    if std_uncertainty is None or not math.isfinite(std_uncertainty):
        return f"{value:.4g} ± ?{space}{sign}"
    std_uncertainty *= factor
    if std_uncertainty <= 0:
        return f"{value:.5g}{space}{sign}"
    digits = decimals(std_uncertainty)
    if value and (most := max(0, 4 - math.floor(math.log10(abs(value))))) < digits:
        # a twin is known to a millionth; more than five digits are not useful
        digits, std_uncertainty = most, max(std_uncertainty, 10.0**-most)
    return f"{value:.{digits}f} ± {std_uncertainty:.{digits}f}{space}{sign}"


def unit_of(unit: str) -> str:
    """Return what stands behind a number in SI.

    Parameters
    ----------
    unit : str
        SI unit.

    Returns
    -------
    str
        A space and the unit; nothing behind a plain number.

    Examples
    --------
    >>> "3.2" + unit_of("s"), "0.44" + unit_of("1")
    ('3.2 s', '0.44')
    """
    return "" if unit == "1" else f" {unit}"


def uncertainty(std_uncertainty: float, unit: str) -> str:
    """Return a part of an uncertainty, to two digits.

    Parameters
    ----------
    std_uncertainty : float
        The part, in `unit`.
    unit : str
        SI unit.

    Returns
    -------
    str
        The text, with the unit as it is `shown`.

    Examples
    --------
    >>> uncertainty(0.00123, "m"), uncertainty(0.0061234, "1"), uncertainty(0.123, "m")
    ('1.2 mm', '0.0061', '120 mm')
    """
    factor, sign = shown(unit)
    space = "" if sign in ("", "°") else " "
    return f"{float(f'{std_uncertainty * factor:.2g}'):g}{space}{sign}"


def relative_uncertainty(shares: Sequence[float | None]) -> str:
    """Return the largest of relative standard uncertainties, to stand behind a value.

    Parameters
    ----------
    shares : sequence of float or None
        Relative standard uncertainties [1]; those that are not known count as none.

    Returns
    -------
    str
        Empty where none is known.

    Examples
    --------
    >>> relative_uncertainty([0.05, 0.12]), relative_uncertainty([None, math.inf])
    (' ± 12 %', '')
    """
    known = [share for share in shares if share is not None and math.isfinite(share)]
    return f" ± {float(f'{100 * max(known):.2g}'):g} %" if known else ""


def percent(value: float | None, std_uncertainty: float | None) -> str:
    """Return a percentage with its sign and standard uncertainty.

    Parameters
    ----------
    value : float or None
        The value [%].
    std_uncertainty : float or None
        Its standard uncertainty [%].

    Returns
    -------
    str
        The text.

    Examples
    --------
    >>> percent(-3.21, 0.84), percent(None, None)
    ('−3.21 ± 0.84 %', '–')
    """
    if value is None:
        return "–"
    if std_uncertainty is None or not math.isfinite(std_uncertainty):
        return f"{value:+.2g} %".replace("-", "−")
    digits = min(decimals(std_uncertainty), 2) if std_uncertainty > 0 else 2
    plus_minus = f"± {std_uncertainty:.{digits}f}" if std_uncertainty >= 0.01 else "± <0.01"
    value = 0.0 if abs(value) < 0.5 * 10**-digits else value  # no negative zero
    return f"{value:+.{digits}f} {plus_minus} %".replace("-", "−")


def z_score(value: float | None, limit: float | None) -> str:
    """Return a difference in units of its standard uncertainty, with the limit beyond which it is significant.

    Parameters
    ----------
    value : float or None
        The difference [1].
    limit : float or None
        The limit [1]; infinite where nothing is known of the scatter.

    Returns
    -------
    str
        The text.

    Examples
    --------
    >>> z_score(-1.234, 2.0), z_score(7.6, 12.71), z_score(2345.6, math.inf), z_score(None, None)
    ('−1.2 (±2.0)', '+7.6 (±12.7)', '>+99 (±∞)', '–')
    """
    if value is None:
        return "–"
    if abs(value) > 99:
        sign = ">+99" if value > 0 else "<−99"
    else:
        sign = f"{0.0 if abs(value) < 0.05 else value:+.1f}".replace("-", "−")
    if limit is None:
        return sign
    return f"{sign} (±{f'{limit:.1f}' if math.isfinite(limit) else '∞'})"


def as_given(value: float | None) -> str:
    """Return the origin of a dimension of a twin, for the record of its assumptions.

    Parameters
    ----------
    value : float or None
        What the rig states.

    Returns
    -------
    str
        The origin, in words.

    Examples
    --------
    >>> as_given(0.25), as_given(None)
    ('as given', 'not stated: assumed')
    """
    return "not stated: assumed" if value is None else "as given"


def decimals(std_uncertainty: float) -> int:
    """Return the decimal places that show two digits of an uncertainty.

    Parameters
    ----------
    std_uncertainty : float
        The uncertainty, above zero.

    Returns
    -------
    int
        Number of places.

    Examples
    --------
    >>> decimals(0.0061), decimals(0.5), decimals(12.0)
    (4, 2, 0)
    """
    return max(0, 1 - math.floor(math.log10(std_uncertainty)))


def counted(number: int, what: str) -> str:
    """Return a number of things in words.

    Parameters
    ----------
    number : int
        The number.
    what : str
        One of them.

    Returns
    -------
    str
        The words.

    Examples
    --------
    >>> counted(1, "repetition"), counted(3, "repetition")
    ('1 repetition', '3 repetitions')
    """
    return f"{number} {what}{'s' if number != 1 else ''}"


def few_of(names: Sequence[str]) -> str:
    """Return names in words; of many the first, and how many others there are.

    Parameters
    ----------
    names : sequence of str
        At least one name.

    Returns
    -------
    str
        The words.

    Examples
    --------
    >>> few_of(["r1"]), few_of(["r1", "r2"]), few_of(["r1", "r2", "r3"])
    ('r1', 'r1 and r2', 'r1 and 2 others')
    """
    first, *others = names
    return f"{first} and {len(others)} others" if len(others) > 1 else " and ".join(names)
