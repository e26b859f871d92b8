"""Effects of friction that depends on time, speed or size.

- ageing.py: ageing of a resting contact: the static friction grows with the logarithm of the waiting time
- friction_drop.py: friction drop: the kinetic friction coefficient is below the static one
- sliding_speed.py: kinetic friction that changes with the sliding speed
- sliding_speed_saturating.py: the same with a limit at high speed
- rolling_lever.py: rolling resistance as a lever arm: a length of the material pair, so that small beads roll less
  easily
- rolling_speed.py: rolling friction that grows with the speed
- rolling_speed_power.py: rolling friction that grows with a fitted power of the speed
"""
