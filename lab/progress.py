"""Progress of long work: a callable that receives the stage, the amount done and the total."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called now and then by long work; must return quickly."""

    def __call__(self, stage: str, done: float, total: float) -> None:
        """`stage` in words ("following the bead"), `done` of `total` in any unit; total 0 means unknown."""


def silent(stage: str, done: float, total: float) -> None:
    """Show no progress.

    Parameters
    ----------
    stage, done, total : str, float, float
        As for `Progress`.
    """
