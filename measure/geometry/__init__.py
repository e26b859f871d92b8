"""Geometric objects in a picture, and the orientation of the camera.

- `calibration_board.py`: `read_board`, `straightened`: distortion, perspective and scale from a calibration board
- `camera_roll.py`: `upright`: camera roll from level edges; checks of a stated roll
- `circle.py`: `fit_circle`
- `horizon.py`: `find_level`, `level_of`: direction of the horizontal as a function of the picture row
- `lines.py`: `long_lines`: long straight edges with sub-pixel precision
"""
