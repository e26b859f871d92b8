"""Reduced models of the rigs, bound to the data of a lab ("benches").

- `unknown`: a global unknown of a fit with its prior and limits.
- `rows`: the repetitions of a lab as one table of rows, and the unknowns of the beads.
- `camera`: calibration unknowns, exposure times and projection of the camera.
- `sensitivities`: predictions and their derivatives with respect to all unknowns.
- `drop`: drop test on a plate.
- `pendulum`: single pendulum that swings freely.
- `double_pendulum`: two colliding pendulums, or a pendulum that hits a wall.
- `roll`: bead that rolls on an incline or a level surface.
- `slide`: clump that slips and slides on a tilting arm.
"""
