"""Nested least squares with random effects for each repetition and each impact.

- `fit`: fits a model to a lab, and screens candidates by one Newton step.
- `normal_equations`: objective and normal equations at given values of the unknowns.
- `levenberg_marquardt`: damped descent with the local unknowns eliminated.
- `impact_scatter`: standard deviation of impact scatter, and timestamp jitter.
- `subset`: a bench restricted to some repetitions and rows.
- `parameter_uncertainty`: value and standard uncertainty of the coefficients of an effect.
"""
