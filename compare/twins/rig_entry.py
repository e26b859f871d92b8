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
        """Return the settings of the experiment's rig.

        Parameters
        ----------
        experiment : Experiment
            Experiment in this rig.

        Returns
        -------
        Settings
            An object of `settings`.
        """
        assert isinstance(experiment.rig, self.settings)
        return cast("Settings", experiment.rig)

    def needed(self, experiment: Experiment) -> tuple[str, ...]:
        """Return the parameters of a contact that the twin cannot do without.

        Parameters
        ----------
        experiment : Experiment
            Experiment that the twin belongs to.

        Returns
        -------
        tuple of str
            Their names.
        """
        return self.needs

    def completed(self, experiment: Experiment, measurements: Sequence[Measurement]) -> tuple[Experiment, str]:
        """Fill in settings that the media show and that are not stated.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose gaps are filled.
        measurements : sequence of Measurement
            Measured repetitions, from whose media the settings are taken.

        Returns
        -------
        experiment : Experiment
            The experiment with these settings.
        seen : str
            What they are, in words; empty where there are none.
        """
        return experiment, ""

    def assumed(self, experiment: Experiment, count: int | None) -> list[str]:
        """Return the settings of the twin that are neither stated nor measured.

        Parameters
        ----------
        experiment : Experiment
            Experiment that the twin belongs to.
        count : int or None
            Number of particles that the user gives.

        Returns
        -------
        list of str
            The settings, in words.
        """
        return []

    def is_photo(self, view: Path) -> bool:
        """Return whether a medium of this rig is a photo, not a film.

        Parameters
        ----------
        view : Path
            Photo or film of a repetition.

        Returns
        -------
        bool
            True for a photo.
        """
        return bool(self.settings.several_views)

    def check_media(self, experiment: Experiment, views: Sequence[Path]) -> None:
        """Refuse media from which the rig's quantities cannot be read.

        Parameters
        ----------
        experiment : Experiment
            Experiment that the media belong to.
        views : sequence of Path
            Media of one repetition.

        Raises
        ------
        BadInput
            If they cannot.
        """

    @abstractmethod
    def known(self, experiment: Experiment) -> dict[str, Any]:
        """Return the keyword arguments of ``measure.<rig>.measurement.measure`` that the lab file states.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose entries are read.

        Returns
        -------
        dict of str to object
            In SI units, by name.
        """

    @abstractmethod
    def stated(self, experiment: Experiment) -> list[Stated]:
        """Return the rig's settings for the report.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose settings are listed.

        Returns
        -------
        list of Stated
            Settings in the order of the report.
        """

    @abstractmethod
    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[Overlay]:
        """Return the curves that are laid over each other.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose curves are drawn.
        measured : sequence of Measurement
            Measured repetitions of the experiment.
        twins : sequence of Twin
            The runs of its twin.

        Returns
        -------
        iterable of Overlay
            Measured and simulated curves that are drawn on common axes.
        """

    def filling(self, experiment: Experiment) -> float | None:
        """Return the mass of all particles, weighed or counted.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose particles are weighed or counted.

        Returns
        -------
        float or None
            Mass [kg]; None where the rig holds a single body, or where it is not known.
        """
        return None

    def stated_start(self, experiment: Experiment) -> float | None:
        """Return the stated value of `starts_from`.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose entries are read.

        Returns
        -------
        float or None
            In the unit of that quantity; None where it is not stated.
        """
        return None

    def contradictions(self, experiment: Experiment, measurements: Sequence[Measurement]) -> Iterable[str]:
        """Return a warning for each repetition that contradicts a stated setting other than `starts_from`.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose settings are checked.
        measurements : sequence of Measurement
            Measured repetitions that are checked against them.

        Returns
        -------
        iterable of str
            Warnings; empty where nothing contradicts.
        """
        return ()

    def keys_to_state(self, experiment: Experiment) -> list[str]:
        """Return the keys of lab.toml without which the twin of a rig of few bodies needs the measurement.

        Parameters
        ----------
        experiment : Experiment
            Experiment that the twin belongs to.

        Returns
        -------
        list of str
            Those that are not stated; empty where none is missing, or stating them is not enough.
        """
        return []

    def needs_measurement(self, experiment: Experiment) -> bool:
        """Return whether the twin takes its start, frame rate or duration from the measurement.

        Parameters
        ----------
        experiment : Experiment
            Experiment that the twin belongs to.

        Returns
        -------
        bool
            True where it takes one of them.
        """
        return False

    def takes_count(self, experiment: Experiment) -> bool:
        """Return whether the lab file leaves open how many particles the twin has.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose entries are read.

        Returns
        -------
        bool
            True where the number is left open.
        """
        return False

    @abstractmethod
    def check(self, experiment: Experiment, *, model: Model, frame_rate: float | None, count: int | None) -> None:
        """Refuse settings that the twin would refuse.

        What depends on a measurement is not checked.

        Parameters
        ----------
        experiment : Experiment
            Experiment whose twin is to be run.
        model : Model
            Contacts and effects.
        frame_rate : float or None
            Frames per second [1/s]; what depends on one that is not known (None) is not checked.
        count : int or None
            Number of particles that the user gives.

        Raises
        ------
        BadInput
            If the twin would.
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

        Parameters
        ----------
        experiment : Experiment
            Experiment whose twin is run.
        contacts : sequence of Contact
            Its contacts, that with the wall first.
        measurements : sequence of Measurement
            Measured repetitions, from which the twin takes what is not stated.
        start : float or None
            Measured mean of `starts_from`, in the unit of that quantity.
        count : int or None
            Number of particles that the user gives.
        seed : int
            Seed of the random numbers.
        effects : Effects
            Effects of the model.
        progress : Progress
            Called with step, number and count.
        numerics : dict of str to object
            Settings of a simulation of many particles.

        Returns
        -------
        Twin
            The twin.
        """
