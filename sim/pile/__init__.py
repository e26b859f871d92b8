"""Simulation of the pile tests (angle of repose).

- pile.py: `run`, the result type `Heap`, checks and picture
- piling.py: beads rain on the middle of a base
- pouring.py: a filled tube is lifted off the base
- emptying.py: a filled container drains through a hole in its floor
"""
