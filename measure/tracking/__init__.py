"""Detect, link and fit moving beads.

- `detect.py`: `moving_spots`, `Search`: areas that differ from the background
- `link.py`: `Linker`, `SpotPath`: spots linked into paths
- `find_paths.py`: `find_paths`: both steps for a whole clip
- `search_by_look.py`: `paths_by_look`: find a bead in every frame by its picture
- `frame_cache.py`: `Album`: frame parts kept for the fit
- `cutouts.py`: pixels around the bead in every frame; occlusions
- `colour_channel.py`: `best_channel`: combination of colours with the best contrast
- `patch.py`: pixels of one fit and its start from image moments
- `disc_model.py`: `Pixels`, `Prior`: model of a shaded, motion-blurred disc with derivatives
- `refine.py`: `locate`, `fit_bead`: sub-pixel fit of a bead
- `bead_image.py`: `BeadImage`, `Look`, `BeadFit`: results of the fit
- `exposure_time.py`: `shutter_of`: exposure time from motion blur
- `consistency.py`: common shading and scatter of the positions along a path
- `follow.py`: `chase_path`, `chase`: fit a bead in all frames of a clip
"""
