"""Shared parts of the twins with one or two bodies: pictures, and error messages with advice on settings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.records import Track

IDEAL = "The bead moves in a vacuum and does not spin at the start."


def flashes(
    tracks: Sequence[Track], particle: Particle, walls: Array | None, *, turned: float = 0.0
) -> npt.NDArray[np.uint8]:
    """Stroboscopic RGB picture of the particle; a clump is rotated anticlockwise by `turned` [rad]."""
    from rigtwin.sim.output.picture import strobe

    if particle.shape is None:
        return strobe(tracks, [particle.radius], walls=walls)
    from scipy.spatial.transform import Rotation

    offsets = Rotation.from_rotvec([0.0, -turned, 0.0]).apply(np.array(particle.shape.offsets))
    return strobe(tracks, particle.shape.radii, offsets, walls=walls)


def ground(track: Track, diameter: float) -> Array:
    """Outline of the plate under a fall, for the picture."""
    from rigtwin.sim.output.picture import slab

    across = track.position[:, 0]
    return slab((across.min() - 3 * diameter, -diameter / 2), (across.max() + 3 * diameter, 0.0))


def settings_to_try(faster: str, duration: float | None, greater: str) -> str:
    """List of settings to try; a longer duration only if one was given, as a record is else long enough."""
    return ", ".join([faster, *(["a longer duration"] if duration is not None else []), greater])


@contextmanager
def as_a_twin(rig: str, remedies: str) -> Iterator[None]:
    """Replace the evaluation's advice on filming by advice on settings of the twin, in the error of the block."""
    try:
        yield
    except BadInput as error:
        words = str(error).removeprefix("bead: ").removeprefix("clump: ").removeprefix("the record: ")
        finding = words.rpartition("; ")[0] or words.rstrip(".")
        raise BadInput(f"the twin of the {rig} gives nothing to measure: {finding}; try {remedies}.") from None
