"""Campaigns: many runs of twins, kept in a store, on this machine or a cluster.

- `run`: one run (a function and its settings), and the results of many.
- `store`: the folder that keeps finished runs; a ledger (SQLite) and arrays (NPZ).
- `runners`: where runs are computed: processes of this machine, Dask workers, jobs of a batch system.
- `campaign`: runs what a store does not contain yet.
- `twin_runs`: the twin of a rig as a run.
- `vary`: parameters that are varied, and designs over them.
- `sweep`: twins at all points of a design, beside what was measured; `sweep_figures` draws them.
- `calibrate`: one set of parameters for all experiments of a lab; `emulator` and `posterior` are its parts.
"""
