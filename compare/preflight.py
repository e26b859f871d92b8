"""Find impossible settings of a lab before anything is measured, simulated or written."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab, fault
from rigtwin.lab.tracked.table import is_table

OPTION = re.compile(r"--(region|known-length|start|end|exclude|frame-rate)\b")
"""Options of `measure` in its messages; a lab file has them as keys of ``[experiments.camera]``."""


def need_possible(lab: Lab, experiment: Experiment, *, count: int | None) -> None:
    """Check that a repetition of the experiment fits its camera settings and that its twin can be run.

    Raises `BadLabFile`, or `BadInput` for a `count` that the twin cannot have.
    """
    if experiment.rejected and not (experiment.repetitions or experiment.measured):
        raise fault(lab, experiment, ("files",), "all repetitions are rejected; accept one of them.")
    rate = _need_view(lab, experiment)
    _need_start(lab, experiment)
    try:
        entry_of(experiment).check(experiment, model=lab.model, frame_rate=rate, count=count)
    except BadInput as error:
        name, colon, why = str(error).partition(": ")
        if name == "count" and count is not None and entry_of(experiment).takes_count(experiment):
            raise BadInput(f"--count: {experiment.id}: the twin cannot be run: {why}") from None
        named = bool(colon) and name.isidentifier()
        said = why if named else str(error)
        raise fault(lab, experiment, (name,) if named else (), f"the twin cannot be run: {said}") from None


def _need_start(lab: Lab, experiment: Experiment) -> None:
    """Check that the start of a twin is stated if there is no repetition from which it could be measured."""
    entry = entry_of(experiment)
    if experiment.repetitions or entry.starts_from is None or entry.stated_start(experiment) is not None:
        return
    why = "this key is missing; the twin starts from it, and there are no repetitions from which it could be measured."
    raise fault(lab, experiment, (entry.starts_from,), why)


def _need_view(lab: Lab, experiment: Experiment) -> float | None:
    """Check the camera settings against the media; returns the frame rate [1/s] if it is known.

    As in measuring, one repetition that fits is enough.  Media are opened only if needed, because a film must be read
    to its end for its timestamps.
    """
    camera = experiment.camera
    cameras = (camera, *experiment.cameras.values())
    stated = any(
        (one.region, one.start, one.end, one.exclude, one.known_length) != (None, None, None, (), None)
        for one in cameras
    )
    asked = camera.frame_rate is None and not entry_of(experiment).many_particles
    if not experiment.repetitions or (not stated and not asked):
        return camera.frame_rate
    first: BadInput | None = None
    for views in experiment.repetitions:
        try:
            return _opened(experiment, views)
        except BadInput as error:
            first = first or error
    assert first is not None  # there are repetitions
    option = OPTION.search(str(first))
    if option is None:
        raise fault(lab, experiment, ("repetitions",), str(first)) from None
    name = option[1].replace("-", "_")
    if name == "start" and camera.start is None:  # the message names both if the interval is too short
        name = "end"
    said = OPTION.sub(lambda found: found[1].replace("-", "_"), str(first))
    raise fault(lab, experiment, ("camera", name), said) from None


def _opened(experiment: Experiment, views: Sequence[Path]) -> float | None:
    """Open the media of a repetition with its camera settings; returns the frame rate [1/s] of a film."""
    from rigtwin.measure.media.photo import read_photo
    from rigtwin.measure.media.sound import is_sound
    from rigtwin.measure.media.video import open_video

    rate = experiment.camera.frame_rate
    for view in views:
        camera = experiment.camera_of(view)
        if is_table(view) or is_sound(view):  # a tracked record has no pictures
            continue
        if entry_of(experiment).is_photo(view):
            read_photo(view, camera)
        else:
            rate = open_video(view, camera).frame_rate
    return rate
