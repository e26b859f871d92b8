"""Effects of the camera: errors of position and time in the record.

- camera_roll.py: camera roll: the camera is turned about its optical axis, so that the vertical leans in the image
- frame_rate_error.py: frame rate error: the true frame rate of the camera differs from the stated one
- lens_distortion.py: radial lens distortion: the scale changes with the distance from the origin of the coordinates
- perspective.py: perspective: the camera looks up or down, so that the scale changes with height
- rolling_shutter.py: rolling shutter: image rows are read one after another, so the exposure time depends on the
  height
- scale_error.py: scale error: the scale of the image is wrong by a constant factor
- timestamp_jitter.py: timestamp jitter: frames are not evenly spaced, so the noise along the path grows with the
  speed
"""
