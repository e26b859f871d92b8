"""Twins: the simulated counterpart of an experiment, evaluated by the same function as the film.

- `rig_entry`: what `compare` needs to know about a rig; `registry` lists the entries.
- `twin`: the result of a twin, and its files.
- `matched`: the twin of an experiment of a lab, with the same settings.
- `by_name`: looks up particle, wall and contact by name.
- `few_body`: shared parts of the twins with one or two bodies.
- `many_body`: shared parts of the twins with many particles.
- `run_warnings`: summarises the warnings of runs.
- `drop`, `pendulum`, `tilt`: twins with one or two bodies.
- `pile`, `packing`, `drum`, `hopper`: twins with many particles.
"""
