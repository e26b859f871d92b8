"""Effects on the restitution of an impact.

- odd_shape.py: non-spherical bead: the directions of its rebounds scatter far more than those of a sphere
- off_centre_impact.py: off-centre impact: the beads do not meet on their line of centres; part of the impulse leaves
  the plane of motion
- plate_compliance.py: plate compliance: bending waves in a thin plate carry energy away, more for larger, denser and
  faster beads
- restitution_plastic.py: restitution that falls with the impact speed as a power law: plastic yield of the contact
- restitution_plastic_yield.py: restitution that falls above a yield speed: elastic impact below it, plastic above
- restitution_viscoelastic.py: restitution that falls with the impact speed: viscoelastic loss
"""
