"""Bulk engine: many spheres, single or in rigid clumps.

- bulk.py: `Bulk`, the public class: particles, walls, domain, running, results
- arena.py: Taichi fields and kernels of the time step
- pair_forces.py: forces between neighbouring spheres, in vectorised packets
- neighbour_list.py: cells, half Verlet list with contact histories, renumbering
- rigid_bodies.py: clumps as rigid bodies
- thread_team.py: threads that make many steps in one launch
- table_layout.py: column numbers of the tables of an arena
- particle_state.py: result types `Beads` and `Grains`
- energy_budget.py: energies and overlaps at one moment
- checkpoint.py: reading and writing of the full state
"""
