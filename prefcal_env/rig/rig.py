"""A plant that only a person can run: they receive θ and return a record."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RecordError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.experiments.rollout import computed
from prefcal_env.tables.sheet import text_of
from prefcal_env.tables.steps import MAX_GAP

from .records import Columns

TIME = "time"


@dataclass(frozen=True)
class Rig:
    """The `run` of a scenario whose experiments are done by a person.

    Records are CSV files with a column `time` and one column for each state, each output that is
    no state, and each input of `channels`, in the channels' units. If the reference of an output
    changes, the record may have a column "NAME ref" as well. Front ends show the person θ, the
    columns and `instructions`.

    Args:
        channels: Names, units, limits and targets of states, inputs and outputs.
        y_ref: Reference of each output, in its unit, for records without a column for it.
        kpis: Function that returns the key performance indicators of a record by name.
        ranges: Maps a channel's name to the range of its sensor, in its unit. A value outside is
            refused: most likely it is in another unit.
        instructions: Instructions that tell the person how to run an experiment.
        max_gap: Longest step in time that is not a gap, in median steps.
        max_rows: Largest number of rows of a record.
        headings: Maps "time" and names of channels to the headings of the record's columns where
            they differ, such as {"temperature": "TI-101.PV"}.
        time_format: Format of time stamps, such as "%d/%m/%Y %H:%M:%S"; None for ISO 8601, or
            days and months with points. They count from the earliest one.

    Raises:
        SettingsError: If references or ranges do not fit the channels, or a bound is not valid.
    """

    channels: Channels
    y_ref: tuple[float, ...]
    kpis: Callable[[Experiment], Mapping[str, float]] | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    instructions: str = ""
    max_gap: float = MAX_GAP
    max_rows: int = 200_000
    headings: Mapping[str, str] = field(default_factory=dict)
    time_format: str | None = None

    signals = ()
    """Additional signals of the records: none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "y_ref", tuple(map(float, self.y_ref)))
        if len(self.y_ref) != len(self.channels.y) or not np.all(np.isfinite(self.y_ref)):
            raise SettingsError(
                f"y_ref must hold a finite reference for each of {len(self.channels.y)} outputs, "
                f"got {self.y_ref}"
            )
        signals = [c.name for c in self.recorded]
        names = (TIME, *signals, *(f"{c.name} ref" for c in self.channels.y))
        unknown = [name for name in self.headings if name not in names]
        if unknown:
            raise SettingsError(f"headings must name some of {names}, got {unknown[0]!r}")
        called = [self.headings.get(name, name) for name in names]
        if len(set(called)) != len(called):
            raise SettingsError(f"the names of the columns must differ, got {tuple(called)}")
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
        """Refuse to run, because only a person can.

        Raises:
            ScenarioError: Always.
        """
        raise ScenarioError(
            "this plant is a rig that only a person can run: calibrate it with the calibrator human"
        )

    @property
    def columns(self) -> Columns:
        """Columns of a record."""
        signals, called = self.recorded, self.headings
        return Columns(
            tuple(called.get(n, n) for n in (TIME, *(c.name for c in signals))),
            (self.channels.time_unit, *(c.unit for c in signals)),
            {called.get(name, name): limits for name, limits in self.ranges.items()},
            self.max_gap,
            self.max_rows,
            {called.get(f"{c.name} ref", f"{c.name} ref"): c.unit for c in self.channels.y},
            self.time_format,
        )

    @property
    def recorded(self) -> tuple[Channel, ...]:
        """Channels with a column, in the order of the columns."""
        return (*self.channels.x, *self._measured, *self.channels.u)

    @property
    def _measured(self) -> tuple[Channel, ...]:
        """Outputs that are no state."""
        states = {(c.name, c.unit) for c in self.channels.x}
        return tuple(c for c in self.channels.y if (c.name, c.unit) not in states)

    def template(self) -> str:
        """Return the first line of a record."""
        return self.columns.template

    def read_bytes(self, content: bytes) -> str:
        """Return a file as CSV. Raises RecordError if it is neither text nor Parquet."""
        return text_of(content)

    def read(
        self, source: Any, theta: Float[np.ndarray, " n"], *, unsafe: bool = False
    ) -> Experiment:
        """Return the experiment of a physical θ, shape (n,), from its record.

        Args:
            source: Text of a CSV, path of a CSV or Parquet file, its content as bytes, or a pandas
                DataFrame. Lines in messages count the headings as line 1.
            theta: Controller parameters of the run.
            unsafe: Whether the run was stopped because it became unsafe.

        Raises:
            RecordError: If the record is not valid; the message lists all problems.
        """
        made = self._of(
            self.columns.read(text_of(source)), theta, End.UNSAFE if unsafe else End.TIME_UP
        )
        return made if self.kpis is None else replace(made, kpis=_computed(self.kpis, made))

    def failed(self, theta: Float[np.ndarray, " n"], text: str | None = None) -> Experiment:
        """Return a failed experiment of a physical θ, shape (n,), without KPIs.

        Args:
            theta: Controller parameters of the run.
            text: Text of a CSV file with the data logged before the failure. With None, or a
                record that `read` would refuse, the experiment has no record.
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
        """Return an experiment without KPIs; `values` come from `Columns.read`."""
        widths = [1, len(self.channels.x), len(self._measured), len(self.channels.u)]
        t, x, measured, u, y_ref = np.split(values, np.cumsum(widths), axis=1)
        count = len(values)
        return Experiment(
            theta=theta, t=t[:, 0], x=x, u=u, t_control=t[:, 0], u_control=u,
            y_ref=np.where(np.isnan(y_ref), np.reshape(self.y_ref, (1, -1)), y_ref),
            iterations=np.zeros(count, dtype=np.int64), solve_time=np.zeros(count),
            solved=np.ones(count, dtype=bool), channels=self.channels, end=end,
            y=self._outputs(x, measured),
        )  # fmt: skip

    def _outputs(
        self, x: Float[np.ndarray, "K n_x"], measured: Float[np.ndarray, "K m"]
    ) -> Float[np.ndarray, "K n_y"] | None:
        """Return the outputs of a record; None if all of them are states."""
        if not self._measured:
            return None
        names = [(c.name, c.unit) for c in (*self.channels.x, *self._measured)]
        places = [names.index((c.name, c.unit)) for c in self.channels.y]
        return np.hstack([x, measured])[:, places]


def _computed(
    kpis: Callable[[Experiment], Mapping[str, float]], made: Experiment
) -> dict[str, float]:
    try:
        return {str(name): float(value) for name, value in computed(kpis, made).items()}
    except Exception as error:
        # The user's own function can raise anything; the record or the function is the cause.
        raise RecordError(
            "the scenario cannot compute the KPIs of this record "
            f"({type(error).__name__}: {error}): fix the record or the scenario"
        ) from error
