"""Find foreign objects in front of a hopper: not the hopper, full or empty, nor the slide, nor beads.

Close around the bed nothing moves.  What differs there from before and after is a hand, whatever its colour.  In front
of bed and slot each pixel shows its first colour, its last colour, a bead, or a mixture of two of these at an edge or
in motion.  A colour that is none of them is foreign.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise, product

import cv2
import numpy as np

from rigtwin.lab.arrays import FloatImage, Image, Marked, Mask
from rigtwin.measure.geometry.disc_morphology import disc, odd

ACROSS = 6.0  # [px], bead diameter in the reduced picture, enough to detect a hand
UNLIKE = 15.0  # [grey levels], least difference from all that a pixel may show
CLEAR = 6.0  # the same in multiples of the noise
TONES = ((0.0, 0.1), (0.45, 0.55), (0.9, 1.0))  # shares of a bed's pixels by brightness: gaps, beads, highlights
COLOURS = 6  # largest number of bead colours in a bed
RARE = 0.05  # share of a bed that may deviate from its tones before another bead colour is added
SOFT = 0.4  # [bead diameters], width of the border of a hand that may be too faint to detect
LEAST = 5.0  # [bead discs], least area of a hand with its border; artefacts of a codec are smaller
ABOUT = (1.0, 3.0)  # [bead diameters], distances from the bed between which nothing moves
OVER_SLIDE = 0.5  # [bead diameters] above the slot's level, lower end of that region
LEAST_CROSSING = 1.5  # [bead discs], least area of it that a hand on its way to the bed hides


@dataclass(frozen=True)
class Usual:
    """Colours that each pixel may show while the hopper empties, at reduced size."""

    first: FloatImage  # BGR, shape (height, width, 3)
    last: FloatImage
    mostly: FloatImage  # grey, shape (height, width, 1): median frame, for pixels where nothing moves
    tones: FloatImage  # of each bead colour, from dark to bright, shape (colours, 3, 3)
    about: Mask  # pixels close to the bed where nothing moves
    zoom: float  # pixels of these images per pixel of the picture
    level: float  # [grey levels], difference above which a pixel shows something else
    bead: float  # [px], bead diameter

    def shown(self, picture: Image) -> FloatImage:
        """The picture at reduced size."""
        return _smaller(picture, self.zoom)

    def mask(self, small: Marked, shape: tuple[int, ...]) -> Mask:
        """A mask at reduced size, enlarged to the picture."""
        return np.asarray(cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST) > 0)


def usual_sight(
    full: Image, empty: Image, mostly: FloatImage, bed: Mask, *, slot_row: float, bead: float, noise: float
) -> Usual:
    """Usual colours of a hopper, from pictures before, after and, in grey, of most frames.

    `bed` marks beads in `full`.  `slot_row` and the diameter `bead` are in px, `noise` in grey levels.
    """
    core = cv2.erode(bed.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    near, far = (cv2.dilate(bed.astype(np.uint8), disc(odd(2 * round(each * bead)))) > 0 for each in ABOUT)
    about = far & ~near
    about[max(round(slot_row - OVER_SLIDE * bead), 0) :] = False
    zoom = min(1.0, ACROSS / bead)
    first, last, grey, close = (_smaller(each, zoom) for each in (full, empty, mostly, about.astype(np.float32)))
    level = UNLIKE + CLEAR * noise
    tones = _tones(full[core if core.any() else bed].astype(np.float32))[None]
    tones = _as_many_as_needed(tones, first, last, _smaller(core.astype(np.float32), zoom) > 0.5, level)
    return Usual(first, last, grey[..., None], tones, close > 0.5, zoom, level, bead * zoom)


def crosses(picture: Image, usual: Usual) -> bool:
    """Whether something is between the bed and its surroundings."""
    if not usual.about.any():
        return False
    shown = usual.shown(picture)
    grey = np.asarray(cv2.cvtColor(shown, cv2.COLOR_BGR2GRAY), np.float32)[..., None]
    passing = np.minimum(_off(shown, usual.first), _off(shown, usual.last))
    for off in (passing, _off(grey, usual.mostly)):
        # flicker of the light changes all pixels alike
        level = usual.level + float(np.median(off[usual.about]))
        found = _opened(off > level)[usual.about].sum()
        if found > LEAST_CROSSING * np.pi / 4 * usual.bead**2:
            return True
    return False


def foreign(picture: Image, usual: Usual) -> Mask:
    """Mask of foreign objects in front, with their soft borders."""
    shown = usual.shown(picture)
    # most pixels show what they showed before
    off = np.minimum(_off(shown, usual.first), _off(shown, usual.last))
    level = usual.level + float(np.median(off))
    unusual = off > level
    off[unusual] = _off_mixtures(shown[unusual], usual.first[unusual], usual.last[unusual], usual.tones)
    found = cv2.dilate(_opened(off > level), disc(odd(2 * round(SOFT * usual.bead))))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(found, connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] > LEAST * np.pi / 4 * usual.bead**2
    large[0] = False
    return usual.mask(large[labels].astype(np.uint8), picture.shape)


def _as_many_as_needed(tones: FloatImage, full: FloatImage, empty: FloatImage, bed: Mask, level: float) -> FloatImage:
    """Tones of as many bead colours as needed so that the bed before the empty hopper contains nothing foreign."""
    beads = full[bed & (_off(full, empty) > level)]
    # beads of one colour differ in brightness; subtracting the mean leaves the hue
    hues = beads - beads.mean(axis=1, keepdims=True)
    for count in range(2, min(COLOURS, len(beads)) + 1):
        strange = np.zeros_like(bed)
        strange[bed] = _off_mixtures(full[bed], empty[bed], empty[bed], tones) > level
        if _opened(strange).sum() <= RARE * bed.sum():
            break
        cv2.setRNGSeed(count)  # reproducible
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.5)
        _, kinds, _ = cv2.kmeans(hues, count, np.empty(0), stop, 3, cv2.KMEANS_PP_CENTERS)
        tones = np.stack([_tones(beads[kinds[:, 0] == kind]) for kind in np.unique(kinds)])
    return tones


def _tones(colours: FloatImage) -> FloatImage:
    """Tones of beads of one colour, from dark to bright, shape (3, 3)."""
    rising = colours[np.argsort(colours.sum(axis=1))]
    parts = [rising[int(low * len(rising)) : int(high * len(rising)) + 1] for low, high in TONES]
    return np.stack([part.mean(axis=0) for part in parts])


def _off_tones(shown: FloatImage, tones: FloatImage) -> FloatImage:
    """Distance of colours, shape (n, 3), from those of beads, of one tone or a mixture of two."""
    pairs = [pair for kind in tones for pair in pairwise(kind)]
    pairs += [(one, other) for kinds in combinations(tones, 2) for one, other in product(*kinds)]
    return np.asarray(np.min([_off_mixture(shown, *pair) for pair in pairs], axis=0), dtype=np.float32)


def _smaller(picture: Image | FloatImage, zoom: float) -> FloatImage:
    small = picture if zoom == 1 else cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)


def _opened(marked: Mask) -> Marked:
    """The mask without single pixels and thin edges."""
    return np.asarray(cv2.morphologyEx(marked.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)


def _off(shown: FloatImage, other: FloatImage) -> FloatImage:
    """Largest difference over the colour channels."""
    return np.asarray(np.abs(shown - other).max(axis=-1), dtype=np.float32)


def _off_mixtures(shown: FloatImage, first: FloatImage, last: FloatImage, tones: FloatImage) -> FloatImage:
    """Distance of colours, shape (n, 3), from all mixtures of two things that these pixels may show."""
    least = _off_mixture(shown, first, last)
    for tone in tones.reshape(-1, 3):
        for scene in (first, last):
            least = np.minimum(least, _off_mixture(shown, scene, tone))
    return np.minimum(least, _off_tones(shown, tones))


def _off_mixture(shown: FloatImage, one: FloatImage, other: FloatImage) -> FloatImage:
    way = other - one
    share = np.sum((shown - one) * way, axis=-1) / np.maximum(np.sum(way * way, axis=-1), 1e-6)
    return _off(shown, one + np.clip(share, 0, 1)[..., None] * way)
