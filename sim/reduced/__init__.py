"""Reduced models of one or two bodies, integrated for many parameter settings at once; used by the diagnosis.

- flight.py: flights of a sphere between impacts
- swing.py: swings of a bob between turning points
- swing_and_collide.py: one or two bobs with collisions
- track.py: motion along a straight track until it stops
"""
