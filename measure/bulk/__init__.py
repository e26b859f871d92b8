"""Heaps and beds of beads seen as a whole.

- `beads.py`: `find_beads`, `more_beads`, `likeness`: circles of a heap and the colour of its beads
- `grain_classes.py`: `grain_classes`: grains, base and vessel in every pixel, by a network
- `outline.py`: `outline_of`: border between beads and background
- `hidden_surface.py`: `covered_columns`: occlusions of a bed's surface
- `bead_spacing.py`: `bead_spacing`: distance of neighbouring beads from the autocorrelation
- `piv.py`: `MeanCorrelation`: displacement of a texture by cross-correlation
- `checks.py`: checks `bead_size` and `views_agree`
"""
