"""Measure quantities from videos and photos; never imports the simulation.

One sub-package per rig (`drop`, `drum`, `hopper`, `packing`, `pendulum`, `pile`, `tilt`) and the steps they share:

- `media`: read videos and photos, with capture times and lens correction
- `scene`: static background, camera shake, brightness
- `tracking`: detect, link and fit moving beads
- `bulk`: outline of heaps and beds, bead size, displacement of a texture
- `geometry`: lines, circles, camera roll, calibration board
- `drawing.py`: annotated pictures, plots and overlay videos
- `refusal.py`: the picture that a refused measurement leaves
- `robust.py`: medians, noise from median deviations, correlation of residuals
"""
