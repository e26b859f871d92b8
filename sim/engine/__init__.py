"""The discrete element method (DEM): state, neighbours, contacts, walls, time integration.

- backend.py: start of Taichi, and launching of kernels
- device.py: names of the devices; does not import Taichi
- contact.py: contact laws (Hertz-Mindlin, linear) and rolling resistance
- effect_terms.py: effects compiled into the equations of motion
- time_step.py: time step from Rayleigh's, and checks of numbers
- bulk/: many spheres and clumps, with neighbour lists and threads
- few/: a few bodies, with many independent copies in one launch
- walls/: shapes, meshes, and contacts with walls
"""
