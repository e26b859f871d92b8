"""Heaps and beds of beads seen as a whole.

- `beads.py`: `find_beads`, `more_beads`: circles of a heap
- `grain_classes.py`: `grain_classes`: grains, base and vessel in every pixel, by a network
- `outline_above.py`: `outline_above`, `surface_between`: border between grains and background
- `outline.py`: `Silhouette`, `View`, `Disc`: what is found; `cheapest_borders`: a border by dynamic programming
- `hidden_surface.py`: `covered_columns`: occlusions of a bed's surface
- `bead_spacing.py`: `bead_spacing`: distance of neighbouring beads from the autocorrelation
- `piv.py`: `MeanCorrelation`: displacement of a texture by cross-correlation
- `checks.py`: checks `bead_size` and `views_agree`
"""
