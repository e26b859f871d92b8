"""Effects of the rig: level, lengths, pivot and release.

- length_error.py: length error: the distance from pivot to bob differs from the stated one
- length_error_ratio.py: the same in proportion to the length: a ruler of wrong scale
- pivot_friction.py: dry (Coulomb) friction in the pivot: a constant torque against the motion
- pivot_viscous.py: viscous friction in the pivot: a torque proportional to the angular velocity
- pivot_viscous_power.py: the same with a fitted power of the angular velocity: a greased bearing
- plate_tilt.py: non-level plate: the bead drifts to the lower side, further with each bounce
- release_speed.py: release speed: the holder pushes or drags the bead as it lets go
- release_spin.py: release spin: the bead leaves the holder spinning and is deflected sideways at the first bounce
- rod_mass.py: mass of the rod or thread: the pendulum swings faster than a point mass on a massless thread
- thread_creep.py: creeping thread: it becomes longer with time under the load
- thread_creep_power.py: the same with a fitted power of the time: fast at first
- thread_stretch.py: elastic thread: it is longer where it is pulled harder
- thread_stretch_exchanged.py: the same with beads exchanged on one thread, so that a heavier one hangs lower
"""
