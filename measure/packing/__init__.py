"""Bed height and bulk density of beads in a measuring cylinder, from photos taken from the side.

Steps of the analysis:

- `measurement`: public `measure`; photos or profile tables to quantities, figures and records
- `observe`: one photo to the outline of the bed [m], its scale and its uncertainty budget
- `evaluate`: public `evaluate`; outlines to bed height and bulk density
- `checks`: self-checks on outline, stated sizes and density
- `figures`: overlay of the photo, plot and record of the outline

Parts of this rig:

- `cylinder`: find walls, floor, beads and outline in the picture
- `grain_region`: region of a photo that is filled with grains, and its sides
- `graduations`: find and read a length gauge beside the cylinder
- `bed_profile`: mean, roughness and straightness of an outline
"""
