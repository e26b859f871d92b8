"""Drop: a bead falls on a plate and bounces.

Steps of the analysis, one file each:

- ``measurement``: `measure`, from a clip or a track to quantities.
- ``find_bead``: observe; the bead is found in the clip and followed (media to record).
- ``evaluate``: `evaluate`, from a track to drop height, rebound heights and restitution.
- ``checks``: checks of gravity, residuals, plane of motion, first fall, frame timing, size and camera.
- ``figures``: annotated video, strobe picture and plot.

Parts of the rig:

- ``select_path``: selects the path of the bead from the paths of everything that moves.
- ``bounce_fit``: fits all flights and contacts of a record at once.
- ``fall_in_air``: fall of a sphere with air drag, longest contact time.
- ``sideways_motion``: fits the horizontal motion.
- ``lost_frames``: detects lost or doubled frames from the flights.
- ``scale``: scale and roll of the film.
- ``line_of_sight``: motion towards the camera or away from it, from the size of the bead's image.

Sound of the impacts:

- ``sound_measurement``: measures a sound recording, or compares a film with its own sound.
- ``impacts``: finds the impacts in a sound.
"""
