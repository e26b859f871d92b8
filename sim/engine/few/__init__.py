"""Few bodies: serial simulations with an adaptive time step, many independent copies in one launch.

- few_body.py: `run` and `run_many`, the cases (`Case`, `Body`) and their results
- batch.py: Taichi fields and kernels for many copies
- step.py: time step of one copy
"""
