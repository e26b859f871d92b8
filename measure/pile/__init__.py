"""Angle of repose, height and width of a heap on a round base, from photos taken from the side.

Steps of the analysis:

- `measurement`: public `measure`; photos or profile tables to quantities, figures and records
- `observe`: one photo to the profile of the heap, its variants one standard deviation away, and its scale
- `evaluate`: public `evaluate`; profiles to angles and lengths with uncertainty budgets
- `checks`: stated sizes, uneven flanks, agreement of views
- `figures`: overlay of the photo, plot and record of the profile

Parts of this rig:

- `silhouette`: find the heap in the picture and correct its outline for perspective
- `base_disc`: find the round base by a template fit
- `repose_angles`: definitions of the graphical and geometric angles
"""
