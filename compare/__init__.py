"""Comparison of measurement and simulation: twins, deviations, reports, diagnosis and published tables.

- `compare_lab`: compares a lab with its twins, from lab.toml to report.html.
- `comparison`: the result of a comparison and its warnings.
- `preflight`: finds impossible settings before anything is measured or simulated.
- `measure_repetitions`: measures all repetitions of a lab in parallel processes.
- `deviation`: combines repetitions and compares measured with simulated quantities.
- `curve_overlays`: compares measured and simulated curves (profiles, discharge, trajectories).
- `result_files`: writes CSV and JSON files, all of them or none.
- `worker_processes`: pools of worker processes.
- `campaign/`: many runs of twins, kept in a store, on this machine or a cluster.
- `twins/`: the simulated counterpart of an experiment, one file for each rig.
- `report/`: the HTML page of a comparison.
- `diagnose/`: names the effect that is missing in a model.
- `reproduce/`: the tables of Hlosta et al. 2020 beside our results.
"""
