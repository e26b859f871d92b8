"""What passes in front of a hopper: neither the hopper, full or empty, nor the slide, nor beads.

Close about the bed nothing moves: what differs there from before and after is a hand, whatever its colour.  In front of
bed and slot each place shows what it showed at first, what it shows at the end, a bead, or a mixture of two of these
where an edge runs or something moves: a colour that is none of them is foreign.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise, product

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import FloatImage, Image, Mask

ACROSS = 6.0  # px across a bead are enough to see a hand
UNLIKE = 15.0  # [grey levels], least difference to all that a place may show
CLEAR = 6.0  # times the noise, likewise
TONES = ((0.0, 0.1), (0.45, 0.55), (0.9, 1.0))  # of a bed's pixels by brightness: gaps and shadows, beads, highlights
COLOURS = 6  # most kinds of beads in a bed that are told apart
RARE = 0.05  # share of a bed that may be off its tones before beads of another colour are looked for
SOFT = 0.4  # bead diameters, as far as the border of a hand may be too faint to be told
LEAST = 5.0  # bead discs that a hand covers at least, its border included; a codec's mistakes are smaller
ABOUT = (1.0, 3.0)  # bead diameters from the bed, between which nothing moves
OVER_SLIDE = 0.5  # bead diameters above the slot's level, as low as that is so
LEAST_CROSSING = 1.5  # bead discs of it that a hand on its way to the bed hides at least


@dataclass(frozen=True)
class Usual:
    """What each place of the picture may show while the hopper empties, made smaller."""

    first: FloatImage  # BGR, shape (height, width, 3)
    last: FloatImage
    mostly: FloatImage  # grey, shape (height, width, 1): of most frames, where nothing moves
    tones: FloatImage  # of each colour of beads, from dark to bright, shape (colours, 3, 3)
    about: Mask  # where nothing moves though it is close to the bed
    zoom: float  # px of these per px of the picture
    level: float  # [grey levels], from which on a place shows none of it
    bead: float  # [px], diameter of a bead

    def shown(self, picture: Image) -> FloatImage:
        """A picture of the size of these."""
        return _smaller(picture, self.zoom)

    def mask(self, small: npt.NDArray[np.uint8], shape: tuple[int, ...]) -> Mask:
        """As large as the picture."""
        return np.asarray(cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST) > 0)


def usual_sight(
    full: Image, empty: Image, mostly: FloatImage, bed: Mask, *, slot_row: float, bead: float, noise: float
) -> Usual:
    """Of a hopper before and after and, grey, in most frames; `bed` marks where beads are in `full`.

    `slot_row` and the `bead`'s diameter are in px, `noise` is that of one frame [grey levels].
    """
    core = cv2.erode(bed.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    near, far = (cv2.dilate(bed.astype(np.uint8), _round(each * bead)) > 0 for each in ABOUT)
    about = far & ~near
    about[max(round(slot_row - OVER_SLIDE * bead), 0) :] = False
    zoom = min(1.0, ACROSS / bead)
    first, last, grey, close = (_smaller(each, zoom) for each in (full, empty, mostly, about.astype(np.float32)))
    level = UNLIKE + CLEAR * noise
    tones = _tones(full[core if core.any() else bed].astype(np.float32))[None]
    tones = _as_many_as_needed(tones, first, last, _smaller(core.astype(np.float32), zoom) > 0.5, level)
    return Usual(first, last, grey[..., None], tones, close > 0.5, zoom, level, bead * zoom)


def crosses(picture: Image, usual: Usual) -> bool:
    """Whether something is on its way between the bed and what is around it."""
    if not usual.about.any():
        return False
    shown = usual.shown(picture)
    grey = np.asarray(cv2.cvtColor(shown, cv2.COLOR_BGR2GRAY), np.float32)[..., None]
    passing = np.minimum(_off(shown, usual.first), _off(shown, usual.last))
    for off in (passing, _off(grey, usual.mostly)):
        # a lamp that flickers moves all pixels alike
        level = usual.level + float(np.median(off[usual.about]))
        found = _opened(off > level)[usual.about].sum()
        if found > LEAST_CROSSING * np.pi / 4 * usual.bead**2:
            return True
    return False


def foreign(picture: Image, usual: Usual) -> Mask:
    """Where something else is in front, its soft border included."""
    shown = usual.shown(picture)
    # most places show what they showed before
    off = np.minimum(_off(shown, usual.first), _off(shown, usual.last))
    level = usual.level + float(np.median(off))
    asked = off > level
    off[asked] = _off_mixtures(shown[asked], usual.first[asked], usual.last[asked], usual.tones)
    found = cv2.dilate(_opened(off > level), _round(SOFT * usual.bead))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(found, connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] > LEAST * np.pi / 4 * usual.bead**2
    large[0] = False
    return usual.mask(large[labels].astype(np.uint8), picture.shape)


def _as_many_as_needed(tones: FloatImage, full: FloatImage, empty: FloatImage, bed: Mask, level: float) -> FloatImage:
    """Tones of each colour of beads, so that the bed before the empty hopper is nothing foreign."""
    beads = full[bed & (_off(full, empty) > level)]
    # beads of one colour differ in how much light they get; what is left without the mean is the colour
    hues = beads - beads.mean(axis=1, keepdims=True)
    for count in range(2, min(COLOURS, len(beads)) + 1):
        strange = np.zeros_like(bed)
        strange[bed] = _off_mixtures(full[bed], empty[bed], empty[bed], tones) > level
        if _opened(strange).sum() <= RARE * bed.sum():
            break
        cv2.setRNGSeed(count)  # the same film gives the same tones
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.5)
        _, kinds, _ = cv2.kmeans(hues, count, np.empty(0), stop, 3, cv2.KMEANS_PP_CENTERS)
        tones = np.stack([_tones(beads[kinds[:, 0] == kind]) for kind in np.unique(kinds)])
    return tones


def _tones(colours: FloatImage) -> FloatImage:
    """Of beads of one colour, from dark to bright, shape (3, 3)."""
    rising = colours[np.argsort(colours.sum(axis=1))]
    parts = [rising[int(low * len(rising)) : int(high * len(rising)) + 1] for low, high in TONES]
    return np.stack([part.mean(axis=0) for part in parts])


def _off_tones(shown: FloatImage, tones: FloatImage) -> FloatImage:
    """How far colours, shape (n, 3), are from those of beads, of one or where two of them meet."""
    pairs = [pair for kind in tones for pair in pairwise(kind)]
    pairs += [(one, other) for kinds in combinations(tones, 2) for one, other in product(*kinds)]
    return np.asarray(np.min([_off_mixture(shown, *pair) for pair in pairs], axis=0), dtype=np.float32)


def _smaller(picture: Image | FloatImage, zoom: float) -> FloatImage:
    small = picture if zoom == 1 else cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)


def _round(radius: float) -> npt.NDArray[np.uint8]:
    across = 2 * max(round(radius), 1) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across)), dtype=np.uint8)


def _opened(marked: Mask) -> npt.NDArray[np.uint8]:
    """Without lone pixels and thin edges."""
    return np.asarray(cv2.morphologyEx(marked.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)


def _off(shown: FloatImage, other: FloatImage) -> FloatImage:
    """Largest difference of the colours."""
    return np.asarray(np.abs(shown - other).max(axis=-1), dtype=np.float32)


def _off_mixtures(shown: FloatImage, first: FloatImage, last: FloatImage, tones: FloatImage) -> FloatImage:
    """How far colours, shape (n, 3), are from all mixtures of two things that these places may show."""
    least = _off_mixture(shown, first, last)
    for tone in tones.reshape(-1, 3):
        for scene in (first, last):
            least = np.minimum(least, _off_mixture(shown, scene, tone))
    return np.minimum(least, _off_tones(shown, tones))


def _off_mixture(shown: FloatImage, one: FloatImage, other: FloatImage) -> FloatImage:
    way = other - one
    share = np.sum((shown - one) * way, axis=-1) / np.maximum(np.sum(way * way, axis=-1), 1e-6)
    return _off(shown, one + np.clip(share, 0, 1)[..., None] * way)
