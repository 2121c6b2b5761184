"""A plant that only a person can run: he gets θ, and brings a record."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RecordError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import Channels, End, Experiment
from prefcal_env.experiments.rollout import computed

from .records import Columns

TIME = "time"


@dataclass(frozen=True)
class Rig:
    """The `run` of a scenario whose experiments somebody does himself.

    Its records are CSV files with a column `time` and one for each state and input of `channels`,
    in the channels' units; where the reference of an output changes, it may have a column
    "NAME ref" besides. In front ends the person sees θ, the columns and `instructions`.

    Args:
        channels: Names, units, limits and targets of states, inputs and outputs.
        y_ref: Reference of each output, in its unit, for records without a column of it.
        kpis: Key performance indicators of a record by name.
        ranges: Name of a channel to what its sensor can show, in its unit: a value outside is
            refused, for it is most likely in another unit.
        instructions: How to run it, for the person.
        max_gap: Longest step in time that is no gap, in median steps.
        max_rows: Most rows of a record.

    Raises:
        SettingsError: references or ranges that do not fit the channels, or an impossible bound.
    """

    channels: Channels
    y_ref: tuple[float, ...]
    kpis: Callable[[Experiment], Mapping[str, float]] | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    instructions: str = ""
    max_gap: float = 3.0
    max_rows: int = 200_000

    signals = ()
    """What its records hold beside states and inputs: nothing."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "y_ref", tuple(map(float, self.y_ref)))
        if len(self.y_ref) != len(self.channels.y) or not np.all(np.isfinite(self.y_ref)):
            raise SettingsError(
                f"y_ref must hold a finite reference for each of {len(self.channels.y)} outputs, "
                f"got {self.y_ref}"
            )
        names = (*self.columns.names, *(f"{c.name} ref" for c in self.channels.y))
        if len(set(names)) != len(names):
            raise SettingsError(f"the names of the columns must differ, got {names}")
        for name, (low, high) in self.ranges.items():
            if name not in names or not low < high:
                raise SettingsError(
                    f"ranges must give low < high of one of {names}, got {name!r}: {low, high}"
                )
        if not self.max_gap > 1 or self.max_rows < 2:
            raise SettingsError(
                f"max_gap must be above 1 and max_rows 2 or more, got {self.max_gap} and "
                f"{self.max_rows}"
            )

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Refuse: only a person can run it.

        Raises:
            ScenarioError: always.
        """
        raise ScenarioError(
            "this plant is a rig that only a person can run: calibrate it with the calibrator human"
        )

    @property
    def columns(self) -> Columns:
        """What a record has to hold."""
        signals = (*self.channels.x, *self.channels.u)
        return Columns(
            (TIME, *(c.name for c in signals)),
            (self.channels.time_unit, *(c.unit for c in signals)),
            self.ranges,
            self.max_gap,
            self.max_rows,
            {f"{c.name} ref": c.unit for c in self.channels.y},
        )

    def template(self) -> str:
        """The first line of a record."""
        return self.columns.template

    def read_bytes(self, content: bytes) -> str:
        """The text of a file. Raises RecordError if it is no UTF-8."""
        try:
            return content.decode("utf-8")
        except UnicodeDecodeError as error:
            raise RecordError(
                f"the record is no text in UTF-8 (byte {error.start}): save it as CSV, UTF-8"
            ) from error

    def read(
        self, text: str, theta: Float[np.ndarray, " n"], *, unsafe: bool = False
    ) -> Experiment:
        """The experiment of θ, physical, (n,), that a record tells of.

        Args:
            text: Of the CSV.
            theta: What was run.
            unsafe: Whether it was stopped because it became unsafe.

        Raises:
            RecordError: it lists what is wrong with the record.
        """
        made = self._of(self.columns.read(text), theta, End.UNSAFE if unsafe else End.TIME_UP)
        return made if self.kpis is None else replace(made, kpis=_computed(self.kpis, made))

    def failed(self, theta: Float[np.ndarray, " n"], text: str | None = None) -> Experiment:
        """An experiment of θ, physical, (n,), that failed, without KPIs.

        Args:
            theta: What was run.
            text: Of the CSV of what was logged until then; one that `read` would refuse, or None,
                leaves an experiment without a record.
        """
        nothing = np.zeros((0, len(self.columns.names) + len(self.columns.optional)))
        if text is None:
            return self._of(nothing, theta, End.FAILED)
        try:
            return self._of(self.columns.read(text), theta, End.FAILED)
        except RecordError:
            return self._of(nothing, theta, End.FAILED)

    def _of(
        self, values: Float[np.ndarray, "K m"], theta: Float[np.ndarray, " n"], end: End
    ) -> Experiment:
        """An experiment without KPIs; `values` are those of `Columns.read`."""
        n_x, n_u, count = len(self.channels.x), len(self.channels.u), len(values)
        t, x, u, y_ref = np.split(values, np.cumsum([1, n_x, n_u]), axis=1)
        return Experiment(
            theta=theta, t=t[:, 0], x=x, u=u, t_control=t[:, 0], u_control=u,
            y_ref=np.where(np.isnan(y_ref), np.reshape(self.y_ref, (1, -1)), y_ref),
            iterations=np.zeros(count, dtype=np.int64), solve_time=np.zeros(count),
            solved=np.ones(count, dtype=bool), channels=self.channels, end=end,
        )  # fmt: skip


def _computed(
    kpis: Callable[[Experiment], Mapping[str, float]], made: Experiment
) -> dict[str, float]:
    try:
        return {str(name): float(value) for name, value in computed(kpis, made).items()}
    except Exception as error:
        # The user's own function: the record may be at fault, or the function.
        raise RecordError(
            "the scenario cannot compute the KPIs of this record "
            f"({type(error).__name__}: {error}): mend the record or the scenario"
        ) from error
