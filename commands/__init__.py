"""The commands: their options, and how results are shown.

- `measure`, `simulate`: one function for each rig.
- `labs`: `compare` and `diagnose`, which take a lab folder.
- `runs`: what a store of runs holds.
- `options`: options that several commands share, among them those of the camera.
- `run_command`: how every command ends: progress, work, results kept and shown.
- `output_folder`: where results go, so that nothing of another input is overwritten.
- `display`: tables for a person, one JSON document for a program.
"""
