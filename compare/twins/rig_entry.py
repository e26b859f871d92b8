"""What `compare` needs to know about a rig: one `RigEntry` for each rig, listed in `registry`.

A new rig adds its entry beside its twin in ``compare/twins/<rig>.py``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar, cast

from rigtwin.lab.materials import PARAMETERS

if TYPE_CHECKING:
    from rigtwin.compare.curve_overlays import Overlay
    from rigtwin.compare.twins.twin import Twin
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.file.model_file import Effects, Model
    from rigtwin.lab.materials import Contact
    from rigtwin.lab.progress import Progress
    from rigtwin.lab.quantity import Measurement

Settings = TypeVar("Settings")


class Stated(NamedTuple):
    """A setting of the rig as the report shows it: ``value * factor`` with `unit`."""

    name: str
    value: float | None  # in SI; None where the lab file does not state it
    factor: float
    unit: str

    @property
    def text(self) -> str:
        """The value with its unit; whole numbers as they are, empty where nothing is stated."""
        if self.value is None:
            return ""
        size = self.value * self.factor
        return f"{size:d}{self.unit}" if isinstance(size, int) else f"{size:.4g}{self.unit}"


class RigEntry(ABC, Generic[Settings]):
    """A rig as `compare` sees it: what it measures, which twin it has, and what the twin is given.

    `Settings` is the rig's settings class in `rigtwin.lab.rigs`.
    """

    settings: ClassVar[type[Any]]
    many_particles: ClassVar[bool] = False  # such a twin does not wait for a measurement and depends on a seed
    # name of one run of the twin, where runs differ from seed to seed by an amount that one run cannot show; runs of
    # few bodies repeat exactly, and a drum's scatters over time, which its uncertainty includes
    run_name: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = PARAMETERS  # parameters of a contact that the twin cannot do without
    starts_from: ClassVar[str | None] = None  # quantity whose measured mean starts the twin unless it is stated

    def rig(self, experiment: Experiment) -> Settings:
        """Return the settings of the experiment's rig."""
        assert isinstance(experiment.rig, self.settings)
        return cast("Settings", experiment.rig)

    def needed(self, experiment: Experiment) -> tuple[str, ...]:
        """Return the parameters of a contact that the twin of the experiment cannot do without."""
        return self.needs

    def completed(self, experiment: Experiment, measurements: Sequence[Measurement]) -> tuple[Experiment, str]:
        """Return the experiment with settings that are not stated taken from its media, and in words what they show."""
        return experiment, ""

    def assumed(self, experiment: Experiment, count: int | None) -> list[str]:
        """Return in words the settings of the twin that are neither stated nor measured."""
        return []

    def is_photo(self, view: Path) -> bool:
        """Whether a medium of this rig is a photo, not a film."""
        return bool(self.settings.several_views)

    def check_media(self, experiment: Experiment, views: Sequence[Path]) -> None:
        """Raise `BadInput` where the rig's quantities cannot be read from these media."""

    @abstractmethod
    def known(self, experiment: Experiment) -> dict[str, Any]:
        """Return the keyword arguments of ``measure.<rig>.measurement.measure`` that the lab file states."""

    @abstractmethod
    def stated(self, experiment: Experiment) -> list[Stated]:
        """Return the rig's settings for the report."""

    @abstractmethod
    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[Overlay]:
        """Return the curves that are laid over each other; `twins` are the runs of the twin."""

    def filling(self, experiment: Experiment) -> float | None:
        """Return the mass [kg] of all particles, weighed or counted; None where the rig holds a single body."""
        return None

    def stated_start(self, experiment: Experiment) -> float | None:
        """Return the stated value of `starts_from`, in that quantity's unit; None where it is not stated."""
        return None

    def contradictions(self, experiment: Experiment, measurements: Sequence[Measurement]) -> Iterable[str]:
        """Return a warning for each repetition that contradicts a stated setting other than `starts_from`."""
        return ()

    def needs_measurement(self, experiment: Experiment) -> bool:
        """Whether the twin takes its start, frame rate or duration from the measurement."""
        return False

    def takes_count(self, experiment: Experiment) -> bool:
        """Whether the lab file leaves open how many particles the twin has."""
        return False

    @abstractmethod
    def check(self, experiment: Experiment, *, model: Model, frame_rate: float | None, count: int | None) -> None:
        """Raise `BadInput` where the twin would refuse its settings.

        What depends on a measurement, or on a `frame_rate` [1/s] that is not known (None), is not checked.
        """

    @abstractmethod
    def twin(
        self,
        experiment: Experiment,
        contacts: Sequence[Contact],
        *,
        measurements: Sequence[Measurement],
        start: float | None,
        count: int | None,
        seed: int,
        effects: Effects,
        progress: Progress,
        numerics: dict[str, Any],
    ) -> Twin:
        """Run the twin.

        `start` is the measured mean of `starts_from` in that quantity's unit, `contacts` has the wall first, `numerics`
        are the settings of a simulation of many particles.
        """
