"""Figures of the studies on the angle of repose."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rigtwin.compare.report.plot_style import canvas, svg

if TYPE_CHECKING:
    from rigtwin.compare.reproduce.studies import Points, Study


def study_figure(study: Study, points: Points) -> str:
    """Angles against the varied quantity, with the standard deviation over piles, as SVG text."""
    colours = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8a94a0")
    with canvas() as (figure, axes):
        for (reading, found), colour in zip(points.items(), colours, strict=False):
            x = [place for place, *_ in found]
            spread = [0.0 if std is None else std for _, _, std, _ in found]
            axes.errorbar(
                x, [mean for _, mean, *_ in found], spread, fmt="o-", ms=4, capsize=3, color=colour, label=reading
            )
        axes.set(xlabel=study.x_label, ylabel="angle of repose / °")
        axes.legend(loc="best", ncols=2, fontsize=7)
        return svg(figure, study.title)
