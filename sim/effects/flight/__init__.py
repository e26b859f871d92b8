"""Effects on a moving bead: forces of the air and of electric charge.

- air_drag.py: quadratic air drag: form drag of a sphere with a constant drag coefficient
- air_drag_schiller_naumann.py: air drag of a sphere from the Stokes through the intermediate to the Newton range
  (Schiller-Naumann)
- air_drag_standard.py: air drag of a smooth sphere by the standard drag curve, in the fit of Brown and Lawler
- buoyancy.py: buoyancy and added mass in air: a light bead falls with less than g
- electrostatic.py: electrostatic attraction of a charged bead by its image charge in the plate
- linear_drag.py: linear (Stokes) drag of the air
- side_attraction.py: attraction by a body beside the fall, far from the bead
- side_attraction_decay.py: attraction by a body close beside the fall, whose pull decays over a length
- side_attraction_near.py: attraction by a body close beside the fall, with the inverse square of the distance
"""
