"""Parts of a run that the rigs share.

- set_up.py: particles, walls and numerical settings of a bulk simulation
- filling.py: placing particles without overlap and waiting until they rest
- trials.py: many trials of a rig with few bodies, simulated in parallel
- frame_times.py: times of the frames of a record
- run_log.py: trajectory, checkpoint and energy balance during a run
"""
