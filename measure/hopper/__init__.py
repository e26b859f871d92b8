"""Discharge of a hopper with a slot that a slide opens: opening, last particle, discharge time and mass flow.

Steps of the analysis:

- `measurement`: public `measure`; clip to quantities, figures and records
- `observe`: the share left in the hopper over time, opening and last particle, from the frames' counts
- `evaluate`: public `evaluate`; the share left over time to times and rates with uncertainty budgets
- `checks`: checks of the picture, of stated sizes, of compression and of the frame rate
- `figures`: annotated video, still, plot and record of what is left

Parts of this rig:

- `outflow`: count the beads above and below the slot in every frame
- `slide_opening`: frame in which the slide uncovers the slot, and the edges of the slot
- `foreign_objects`: find objects that are neither hopper, slide nor beads
- `falling_stream`: motion of the beads below the slot by cross-correlation
- `free_fall_clock`: check of the frame rate by the acceleration of the beads
- `lost_frames`: missing and repeated frames during the flow
- `scale`: scale and outlet velocity
"""
