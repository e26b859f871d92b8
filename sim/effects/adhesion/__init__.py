"""Effects of adhesion, at impacts and at lasting contacts.

- adhesion.py: adhesion at an impact: each impact loses a fixed energy, so slow impacts rebound less and finally stick
- adhesion_jkr.py: adhesion of two elastic spheres (JKR), including the neck that holds while they separate
- cohesion_sjkr.py: linear cohesion (simplified JKR): an attractive force proportional to the contact area
- contact_adhesion.py: adhesion between clump and arm: adds to the normal force that friction acts on
- contact_adhesion_load.py: adhesion between clump and arm: a friction coefficient that falls with a power of the load
"""
