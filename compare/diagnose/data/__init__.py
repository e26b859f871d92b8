"""Reading tracked labs and checking them before the fit.

- `tracked_lab`: the types of a lab ready for diagnosis, and checks of its statements.
- `read_lab_json`: reads a lab.json with its track files.
- `from_lab_toml`: turns the experiments of a lab.toml into a tracked lab.
- `axis_checks`: checks that the columns of the tracks are the axes of the rig.
- `exclusions`: leaves out unusable rows and repetitions and reports each.
- `tracking_noise`: estimates the tracking noise from the tracks.
"""
