"""Dynamic angle of repose of beads in a slowly turning drum, from a clip of its end or from a photo.

Steps of the analysis:

- `measurement`: public `measure`; clip or photo to quantities, figures and records
- `evaluate`: public `evaluate`; profiles over time to angles with uncertainty budgets
- `checks`: checks of the picture: rim, fill, shape of the surface, glare
- `figures`: annotated video, still, plot and record of the surface

Parts of this rig:

- `rim`: find the circle of the drum's inner wall
- `bed`: segment the bed in every frame by colour, motion and texture
- `profiles`: borders of the bed to profiles of its surface, without flights and occlusions
- `rotation`: direction of rotation, and whether the picture is upright
- `glare`: reflections over the surface
- `time_average`: mean of a correlated record, steady part, avalanches
"""
