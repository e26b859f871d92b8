"""Figures of the studies on the angle of repose."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rigtwin.compare.report.figure_file import FigureFile, column_name, figure_file, slug
from rigtwin.compare.report.plot_style import canvas

if TYPE_CHECKING:
    from rigtwin.compare.reproduce.studies import Points, Study


def study_figure(study: Study, points: Points) -> FigureFile:
    """Angles against the varied quantity, with the standard deviation over piles."""
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
        columns = ("reading", column_name(study.x_label), "mean_deg", "std_deg", "piles")
        rows = [
            dict(zip(columns, (reading, *point), strict=True)) for reading, found in points.items() for point in found
        ]
        caption = f"{study.title}, rolling {study.rolling}: mean and standard deviation over piles."
        return figure_file(figure, slug(f"study-{study.name}-{study.rolling}"), study.title, rows, columns, caption)
