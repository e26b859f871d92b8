"""One figure of measured or simulated records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rigtwin.lab.records import Profile, Series, Track


def record_figure(tracks: Sequence[Track], profiles: Sequence[Profile], series: Sequence[Series]) -> Figure:
    """Draw records below each other, one panel for each kind that there is.

    Parameters
    ----------
    tracks : sequence of Track
        Drawn as x and y [mm] over time [s].
    profiles : sequence of Profile
        Drawn as height [mm] over x [mm].
    series : sequence of Series
        Drawn over time [s], each in its unit.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    from matplotlib.figure import Figure

    panels = max(2 * bool(tracks) + bool(profiles) + len(series), 1)
    figure = Figure(figsize=(7, 2.4 * panels), layout="constrained")
    axes = iter(figure.subplots(panels, 1, squeeze=False)[:, 0])
    for column, name in ((1, "height y / mm"), (0, "x / mm")) if tracks else ():
        panel = next(axes)
        for track in tracks:
            panel.plot(track.time, 1e3 * track.position[:, column], ".", markersize=3, label=track.body)
        panel.set_xlabel("time / s")
        panel.set_ylabel(name)
        if len(tracks) > 1:
            panel.legend()
    if profiles:
        panel = next(axes)
        for profile in profiles:
            panel.plot(1e3 * profile.x, 1e3 * profile.height, label=profile.view)
        panel.set_xlabel("x / mm")
        panel.set_ylabel("height / mm")
        panel.set_aspect("equal")
        panel.legend()
    for one in series:
        panel = next(axes)
        panel.plot(one.time, one.value)
        panel.set_xlabel("time / s")
        panel.set_ylabel(f"{one.quantity.replace('_', ' ')} / {one.unit}")
    return figure
