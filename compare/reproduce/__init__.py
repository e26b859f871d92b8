"""The tables of Hlosta et al. 2020 beside the results of our twins with the paper's calibrated parameters.

- `reproduce`: runs what the tables and studies need and writes the results.
- `tables`: the cells of the tables and the runs that fill them.
- `studies`: studies of influences on the angle of repose.
- `paper_runs`: one function for each rig of the paper, and the assumptions made.
- `run_time`: estimated run time of each run.
- `figures`: figures of the studies.
"""
