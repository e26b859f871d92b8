"""Tilt: a plate rises until a body on it slides or rolls.

Steps of the analysis, one file each:

- ``measurement``: `measure`, from a clip to quantities.
- ``observe``: plate and body are followed through the film (media to record), scale and horizontal found.
- ``evaluate``: `evaluate`, from angle and track to friction and its angle at the onset.
- ``checks``: checks of a record: gravity, proportions, kind of motion, creep, rise, residuals, rest.
- ``film_checks``: checks of a film: shape of the body, view of the plate, frame timing, horizontal.
- ``figures``: annotated video, still picture and plot.

Other media and rigs:

- ``measure_table``: measures tables of the plate's angle and of the body's track.
- ``incline``: friction in motion on a plate that stands still.

Parts of the rig:

- ``plate_angle``: finds the plate (a straight arm that turns about a hinge) and its direction in every frame.
- ``body_track``: finds the body at rest on the plate and follows it to a fraction of a pixel.
- ``occluders``: finds objects in front of the plate.
- ``onset``: finds the onset of motion as a change point.
- ``lost_frames``: detects lost or doubled frames from the turn of the plate or the run of the body.
"""
