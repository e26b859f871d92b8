"""Walls: shapes, meshes, and contacts of beads with them.

- shapes.py: `Wall`, `Motion` and the shapes (plane, disc, annulus, cylinder, cone, plate, box)
- mesh.py: walls of triangles: reading, checks, sorting into cells
- elements.py: planes, surfaces of revolution and triangles, of which all walls consist, and distances to them
- wall_table.py: the walls of a simulation as tables of numbers
- wall_contacts.py: Taichi fields and functions for contacts, their histories and forces
"""
