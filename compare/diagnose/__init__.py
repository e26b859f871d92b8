"""Diagnosis of tracked experiments: find where measurement and model disagree, and name the missing effect.

- `diagnose_folder`: reads a folder, runs the diagnosis and writes its files.
- `diagnosis`: the steps of the diagnosis of one lab, and its result.
- `page`: the HTML page of a diagnosis.
- `data/`: reading and checking tracked labs.
- `models/`: reduced models of the rigs, with their unknowns and derivatives.
- `fitting/`: nested least squares, random effects and uncertainties.
- `selection/`: choice of effects, formulas, gap, stability and next experiment.
"""
