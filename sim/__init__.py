"""Simulation: from a model and a rig to records, as a measurement would give them.  Never imports `rigtwin.measure`.

One file per rig, each with a function `run`:

- drop.py: drop test with a sphere
- drop_clump.py: drop test with a clump (non-spherical particle)
- pendulum.py: double pendulum, or one bob against a wall
- tilt.py: tilting plate, sliding or rolling
- packing.py: filling of a measuring cylinder
- drum.py: rotating drum
- hopper.py: discharge of a conical or slot hopper
- pile/: angle of repose by piling, pouring or emptying

Shared by the rigs:

- run/: set-up, filling, trials, frame times, run log
- output/: trajectories, pictures, outlines, mixing index
- reduced/: fast one-body models for the diagnosis
- engine/: the DEM: contact laws, walls, time integration
- effects/: catalogue of effects that extend the plain model
- decks/: input files for other DEM codes, and the reading of what they write
"""
