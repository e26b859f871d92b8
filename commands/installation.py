"""Checks of the installation and the machine, one finding each (`rigtwin doctor`)."""

from __future__ import annotations

import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from rigtwin.lab.errors import RigtwinError

State = Literal["ok", "warning", "failed", "note"]

MEMORY_EACH = 0.5e9  # [bytes] per core; measuring a clip or photo takes 0.3 to 0.45 GB, and `compare` uses every core
ENOUGH_DISK = 0.5e9  # [bytes]; a measured clip leaves 1 MB: some hundred of them, with checkpoints of twins
PATIENCE = 60.0  # [s], for the engine; it answers in two where its kernels have never been compiled
REINSTALL = "install rigtwin again (`make demo`, or `pip install --force-reinstall` of its folder)"
EXTRAS = {
    "dask": "`--cluster tcp://host:port` of compare, reproduce, sweep and calibrate",
    "slurm": "`--cluster slurm` of compare, reproduce, sweep and calibrate",
}


@dataclass(frozen=True)
class Finding:
    """Result of a check.

    `failed`: something required does not work; `warning`: it works with a limitation; `note`: something optional.
    """

    check: str
    state: State
    message: str


def findings() -> Iterator[Finding]:
    """Check what rigtwin requires, then the machine, then what is optional.

    Yields
    ------
    Finding
        One per check, as soon as it is known.
    """
    yield from _in_words("packages", _requirements)
    yield from _in_words("engine", _engine_and_media)
    yield from _in_words("results", _results)
    yield from _in_words("memory", _memory)
    yield from _in_words("threads", _threads)
    yield from _in_words("extras", _extras)
    yield from _in_words("other codes", _other_codes)


def _in_words(check: str, look: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """What a check finds; one that cannot be made has failed, and the others are made all the same."""
    try:
        yield from look()
    except RigtwinError as error:
        yield Finding(check, "failed", str(error))
    except Exception as error:
        reason = next(iter(str(error).splitlines()), "") or "no reason given"
        yield Finding(check, "failed", f"{type(error).__name__}: {reason}; {REINSTALL}.")


def _requirements() -> Iterator[Finding]:
    from packaging.requirements import Requirement
    from packaging.specifiers import SpecifierSet

    try:
        asked = metadata.metadata("rigtwin")["Requires-Python"]
        listed = [Requirement(text) for text in metadata.requires("rigtwin") or ()]
    except metadata.PackageNotFoundError:
        yield Finding(
            "packages", "failed", "rigtwin is not installed as a package, so its requirements are unknown; "
            "run `make demo` or `pip install .` in its folder."
        )  # fmt: skip
        return
    version = platform.python_version()
    if SpecifierSet(asked).contains(version, prereleases=True):
        yield Finding("python", "ok", f"Python {version}.")
    else:
        yield Finding(
            "python", "failed", f"Python {version} runs, {asked} is needed; install rigtwin with another one."
        )
    required = [one for one in listed if one.marker is None or one.marker.evaluate({"extra": ""})]
    unmet = [f"{words}; run `pip install '{one}'`." for one in required if (words := _unmet(one))]
    yield from (Finding("packages", "failed", words) for words in unmet)
    if not unmet:
        yield Finding("packages", "ok", f"all {len(required)} required packages are installed as needed.")


def _unmet(requirement: object) -> str:
    """Why an installed version does not satisfy a requirement; empty where it does."""
    from packaging.requirements import Requirement

    assert isinstance(requirement, Requirement)
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return f"{requirement.name} is not installed"
    if requirement.specifier.contains(version, prereleases=True):
        return ""
    return f"{requirement.name} {version} is installed, {requirement.specifier} is needed"


def _engine_and_media() -> Iterator[Finding]:
    """The engine runs in a process of its own: if a library ends it, the other checks go on; so they do meanwhile."""
    from rigtwin.compare.worker_processes import spawned

    with spawned(1, work="ran Taichi", less=REINSTALL) as pool:
        engine = pool.submit(_engine)
        yield from _in_words("film", _film)
        yield from _in_words("photo", _photo)
        try:
            answer = engine.result(timeout=PATIENCE)
        except TimeoutError:
            raise RigtwinError(
                f"Taichi has not answered within {PATIENCE:.0f} s; close other programs and run again."
            ) from None
    yield from _engine_findings(*answer)


def _engine() -> tuple[bool, str, str]:
    from rigtwin.sim.engine.self_test import engine_answer

    return engine_answer()


def _engine_findings(right: bool, where: str, cache: str) -> Iterator[Finding]:
    version = metadata.version("taichi")
    if right:
        yield Finding("engine", "ok", f"Taichi {version} computes a sum correctly ({where}).")
    else:
        yield Finding("engine", "failed", f"Taichi {version} computes a wrong sum ({where}); {REINSTALL}.")
    if _writable(Path(cache)):
        yield Finding("cache", "ok", f"compiled kernels are kept in {cache}.")
    else:
        yield Finding(
            "cache",
            "warning",
            f"nothing may be written into {cache}, so every start of a twin compiles its kernels anew; correct its "
            "permissions, or name another folder in the environment variable TI_OFFLINE_CACHE_FILE_PATH.",
        )


def _film() -> Iterator[Finding]:
    """Write a clip that becomes brighter, and read it back."""
    import av
    import numpy as np

    from rigtwin.lab.camera import Camera
    from rigtwin.measure.drawing import OverlayVideo
    from rigtwin.measure.media.video import open_video

    levels = np.linspace(60, 200, 8)
    with tempfile.TemporaryDirectory(prefix="rigtwin-doctor-") as folder:
        clip = Path(folder) / "clip.mp4"
        with OverlayVideo(clip, frame_rate=30) as video:
            for level in levels:
                video.write(np.full((64, 96, 3), round(level), np.uint8))
        means = [frame.grey.mean() for frame in open_video(clip, Camera()).frames()]
    ffmpeg = ".".join(map(str, av.library_versions["libavcodec"]))
    with_what = f"PyAV {av.__version__} with libavcodec {ffmpeg}"
    # luma of limited range: 16 + 219/255 of the grey level
    if len(means) == len(levels) and np.allclose(means, 16 + 219 / 255 * levels, atol=3):
        yield Finding("film", "ok", f"a clip is written and decoded ({with_what}).")
    else:
        yield Finding("film", "failed", f"a clip is decoded with other pictures than were written ({with_what}).")


def _photo() -> Iterator[Finding]:
    """Write a photo, read it back, and let the network look at it."""
    import cv2
    import numpy as np

    from rigtwin.measure.bulk.grain_classes import grain_classes
    from rigtwin.measure.media.photo import read_photo

    picture = np.zeros((96, 128, 3), np.uint8)
    picture[:, 64:] = 200
    with tempfile.TemporaryDirectory(prefix="rigtwin-doctor-") as folder:
        path = Path(folder) / "photo.jpg"
        path.write_bytes(cv2.imencode(".jpg", picture)[1].tobytes())
        photo, _ = read_photo(path)
    if photo.shape == picture.shape and np.allclose(photo[:, ::16], picture[:, ::16], atol=12):
        yield Finding("photo", "ok", f"a photo is written and decoded (OpenCV {cv2.__version__}).")
    else:
        yield Finding("photo", "failed", f"a photo is decoded wrongly (OpenCV {cv2.__version__}); {REINSTALL}.")
    try:
        shares = grain_classes(photo).sum(axis=2)
        reason = "" if np.allclose(shares, 1, atol=1e-3) else "its shares do not add up to 1"
    except cv2.error as error:
        reason = next(iter(str(error).splitlines()), "OpenCV cannot run it")
    if reason:
        words = f"the network of `measure pile` and `measure packing` does not run ({reason}); {REINSTALL}."
        yield Finding("network", "failed", words)
    else:
        yield Finding("network", "ok", "the network of `measure pile` and `measure packing` runs.")


def _results() -> Iterator[Finding]:
    here = Path.cwd()
    if not _writable(here):
        yield Finding(
            "results",
            "warning",
            f"nothing may be written into {here}, where results go by default; change the folder, or give --out.",
        )
    free = shutil.disk_usage(here).free
    if free < ENOUGH_DISK:
        yield Finding("disk", "warning", f"{_gigabytes(free)} are free for {here}; free some space, or give --out.")
    else:
        yield Finding("disk", "ok", f"{_gigabytes(free)} are free for {here}.")


def _memory() -> Iterator[Finding]:
    import psutil

    from rigtwin.sim.engine.backend import available_threads

    memory, wanted = psutil.virtual_memory(), MEMORY_EACH * available_threads()
    words = f"{memory.available / 1e9:.1f} of {_gigabytes(memory.total)} of memory are free"
    if memory.available < wanted:
        yield Finding(
            "memory", "warning", f"{words}, `compare` takes about {_gigabytes(wanted)}; close other programs before."
        )
    else:
        yield Finding("memory", "ok", f"{words}.")


def _threads() -> Iterator[Finding]:
    from rigtwin.sim.engine.backend import available_threads

    usable, cores = available_threads(), os.cpu_count() or 1
    yield Finding("threads", "ok", f"{usable} of {cores} cores may be used.")


def _extras() -> Iterator[Finding]:
    from packaging.requirements import Requirement

    try:
        listed = [Requirement(text) for text in metadata.requires("rigtwin") or ()]
    except metadata.PackageNotFoundError:  # said above
        return
    for extra, use in EXTRAS.items():
        needed = [one for one in listed if one.marker is not None and one.marker.evaluate({"extra": extra})]
        unmet = [words for one in needed if (words := _unmet(one))]
        if unmet:
            words = f"{', '.join(unmet)}; only {use} needs it: pip install 'rigtwin[{extra}]'."
            yield Finding(extra, "note", words)
        else:
            have = ", ".join(f"{one.name} {metadata.version(one.name)}" for one in needed)
            yield Finding(extra, "ok", f"{have}, for {use}.")


def _other_codes() -> Iterator[Finding]:
    """Codes that compute exported decks, by the first word of the command that runs a deck."""
    from rigtwin.sim.decks import deck, lammps, liggghts, yade

    for code, writer in {"liggghts": liggghts, "lammps": lammps, "yade": yade}.items():
        binary = writer.COMMAND.split()[0]
        where = shutil.which(binary)
        use = f"decks of `rigtwin export {code}`"
        words = f"{where}, for {use}." if where else f"no `{binary}` on the PATH; only {use} need it."
        yield Finding(deck.TITLES[code], "note", words)  # type: ignore[index]


def _writable(folder: Path) -> bool:
    """Whether a file can be made in this folder, or in the nearest one above it that exists."""
    standing = next((above for above in (folder, *folder.absolute().parents) if above.exists()), folder)
    try:
        with tempfile.TemporaryFile(dir=standing):
            return True
    except OSError:
        return False


def _gigabytes(size: float) -> str:
    return f"{size / 1e9:.1f} GB"
