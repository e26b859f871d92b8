"""Pendulum: a bead swings into a second bead at rest (double pendulum), or into a wall.

Steps of the analysis, one file each:

- ``measurement``: `measure`, from a clip or a record to quantities.
- ``observe``: the beads are followed through the film, their swings fitted in pixels, the scale found.
- ``evaluate``: `evaluate`, from tracks to restitution, release and rebound angles.
- ``checks``: checks of momentum, gravity, lengths, contact angle, residuals, lens, frame timing and camera.
- ``figures``: annotated video, still picture and plot.

Parts of the rig:

- ``find_collision``: finds the collision among the paths of everything that moves.
- ``track_two_beads``: locates both beads of a double pendulum in every frame.
- ``track_one_bead``: locates the bead of a wall pendulum.
- ``swing_model``: equation of motion of one or two damped pendulums with collisions.
- ``swing_fit``: fits the model to tracks, with covariance.
- ``lost_frames``: detects lost or doubled frames from the phase of the swing.
"""
