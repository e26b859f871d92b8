"""Read videos and photos.

- `video.py`: `open_video`, `Video`, `Frame`
- `photo.py`: `read_photo`
- `sound.py`: `read_sound`: the sound of a recording or a film
- `sources.py`: choose the reader for a file or folder; `Altered` corrects lens and perspective, or covers regions
- `video_file.py`: video files through FFmpeg, with a cache of decoded pictures
- `image_stack.py`: folders of numbered pictures, multi-page TIFF files
- `photron.py`: Photron recordings (.cihx, .cih, .mraw)
- `pictures.py`: bit depth, brightness, colour, pixel aspect ratio, rotation; interface `Source`
- `time_base.py`: capture times from time stamps and frame rates
- `duplicate_frames.py`: detect and remove repeated frames
- `frame_loss.py`: lost frames and corrected times
- `compression.py`: check of the bits per pixel
- `truncation.py`: detect truncated video files
- `ignored_regions.py`: cover regions that the user wants ignored
- `undistort.py`: lens distortion and perspective correction
- `validation.py`: refusal of missing files and of places outside the picture
"""
