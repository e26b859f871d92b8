"""Types that measurement and simulation share; imports nothing else of rigtwin.

What an experiment is:

- `rigs`: geometry and settings of each rig, and the list of rigs.
- `materials`: materials, particles and contacts.
- `clumps`, `stl_grain`, `size_distributions`: shapes of clumps, also in place of an STL body; sizes that are not alike.
- `camera`: what is stated of the camera and of places in the picture.
- `file/`: reads lab.toml and model.toml.
- `tracked/`: reads tables of tracked data.
- `reference/`: published materials, particles and contacts.

What comes out:

- `records`: tracks, profiles and series.
- `quantity`: quantities with uncertainties, checks, measurements.
- `record_figure`, `formatting`: a figure of records; numbers and names for people.
- `errors`, `progress`: errors that the user can act on; progress of long work.

Tools:

- `arrays`, `units`, `checksums`, `version`: array types, quantities with units, checksums of media, the version.
- `spelling`: which known name a misspelt one means.
- `integration`: equations of motion in time.
- `drum_flow`, `rolling_conventions`: whether the bed of a drum flows; rolling friction in other codes.
"""
