"""Results of simulations as files, pictures and numbers.

- trajectory.py: frames in GSD or VTKHDF files, and the walls as a mesh
- picture.py: pictures of spheres and walls
- outline.py: outlines (silhouettes) of beds and heaps
- mixing.py: Lacey's mixing index
"""
