"""Static background of a clip, and the frames registered to it.

- `background.py`: `learn_scene`, `Background`: median over frames spread in time
- `scene.py`: `Scene`: background with its noise; shift and brightness of a frame relative to it
- `pose.py`: `Pose`, `View`: result of the registration
- `steadied_frames.py`: frames cropped, downsampled, without camera shake and flicker
- `contrast_stretch.py`: `exposure_of`: contrast stretch of dark pictures
- `checks.py`: checks `static_camera` and `bead_in_view`
"""
