"""Which curves of an experiment are drawn, and several runs of one θ as one experiment."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ExperimentError, ScenarioError
from prefcal_env.units import conversion, same
from prefcal_env.wording import did_you_mean

from .experiment import ARRAYS, BEST_FIRST, Channel, Channels, Experiment

KINDS = {"x": "states", "u": "inputs", "y": "outputs", "signal": "signals"}
"""Maps each kind of curve to the name of its group."""


@dataclass(frozen=True, slots=True)
class Plot:
    """One curve and its look: a `Panel` whose channel has been found."""

    channel: Channel  # title, unit, limits, target and band, all as drawn
    kind: str  # "x", "u", "y" or "signal"
    name: str  # of the channel or signal in the experiment
    nth: int = 0  # position among the channels of the same name
    scale: float = 1.0  # factor from the experiment's unit to the unit of `channel`
    reference: str = ""  # see `Panel`, as are the two limits; "" for none
    low_signal: str = ""
    high_signal: str = ""

    @property
    def held(self) -> bool:
        """Whether the curve is drawn as steps, since inputs are held between instants."""
        return self.kind == "u"

    def values(self, experiment: Experiment) -> Float[np.ndarray, " K"]:
        """Return the curve on `experiment.t`, shape (K,); NaN if the experiment lacks it."""
        found = _data(experiment, self) if len(experiment.t) else np.zeros(0)
        return np.full(len(experiment.t), np.nan) if found is None else self.scale * found

    def beside(self, experiment: Experiment) -> tuple[Float[np.ndarray, " K"] | None, ...]:
        """Return the reference and both limits that change, each on `experiment.t`, shape (K,).

        They are in the panel's unit; None for each that it does not name or the experiment lacks.
        """
        there = experiment.signals if len(experiment.t) else {}
        names = (self.reference, self.low_signal, self.high_signal)
        return tuple(self.scale * np.asarray(there[key]) if key and key in there else None for key in names)


class PanelCurves(NamedTuple):
    """The curves of one panel on `t` of an experiment, in the panel's unit, each of shape (K,)."""

    values: Float[np.ndarray, " K"]  # NaN if the experiment lacks the curve
    reference: Float[np.ndarray, " K"] | None  # one that changes, as the limits
    low: Float[np.ndarray, " K"] | None
    high: Float[np.ndarray, " K"] | None


def panel_curves(plots: Iterable[Plot], experiment: Experiment) -> list[PanelCurves]:
    """Return all that is drawn of an experiment, for each of its plots."""
    return [PanelCurves(plot.values(experiment), *plot.beside(experiment)) for plot in plots]


@dataclass(frozen=True, slots=True)
class Panel:
    """One plot of an experiment: the state, input, output or signal called `name`.

    Inputs are drawn as steps, everything else as lines. Attributes that you leave out are taken
    from the channel; a state that is also an output, in the same unit, shows that output's target
    and band.

    Args:
        name: Name (or symbol) of a channel of the experiment, or key of a signal.
        kind: Where to look if the name is not unique: "x", "u", "y" or "signal".
        title: Displayed name.
        unit: Displayed unit; required if `scale` is given. The channel's converts into it.
        low: Lower limit, in the displayed unit; -inf for none.
        high: Upper limit, in the displayed unit; inf for none.
        target: Desired value, in the displayed unit.
        band: Accepted distance from the target, in the displayed unit.
        symbol: Mathtext symbol.
        scale: Factor from the channel's unit to `unit`, for units that are not known, such as turns.
        reference: Key of the signal that holds a reference that varies in time, in the channel's
            unit.
        low_signal: Key of the signal that holds a lower limit that varies in time, in the
            channel's unit. It is drawn in place of `low`, which states its smallest value.
        high_signal: Key of the signal that holds an upper limit that varies in time, in the
            channel's unit. It is drawn in place of `high`, which states its largest value.

    Raises:
        ScenarioError: If the name is empty, the kind is unknown, a scale comes without a unit, or
            the limits are impossible.
    """

    name: str
    kind: str = ""
    _: KW_ONLY
    title: str = ""
    unit: str | None = None
    low: float | None = None
    high: float | None = None
    target: float | None = None
    band: float | None = None
    symbol: str | None = None
    scale: float = 1.0
    reference: str = ""
    low_signal: str = ""
    high_signal: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ScenarioError(f"a panel needs the name of a channel or signal, got {self.name!r}")
        if self.kind not in ("", *KINDS):
            raise ScenarioError(
                f"panel {self.name!r}: kind must be one of {list(KINDS)} or left out, got {self.kind!r}"
            )
        if not np.isfinite(self.scale) or self.scale == 0:
            raise ScenarioError(f"panel {self.name!r}: scale must be finite and not 0, got {self.scale}")
        if self.scale != 1 and self.unit is None:
            raise ScenarioError(
                f"panel {self.name!r}: scale {self.scale:g} changes the unit: give the new one as unit="
            )
        if self.band is not None and not self.band > 0:
            raise ScenarioError(f"panel {self.name!r}: band must be above 0, got {self.band}")

    def plot(self, experiment: Experiment) -> Plot:
        """Find the curve in `experiment`, which must have a record.

        Raises:
            ScenarioError: If no channel or signal, or more than one, has this name, or the
                experiment did not record it.
        """
        plot = self.among(experiment.channels, experiment.signals)
        self._check_state_is_output(plot, experiment)
        if _data(experiment, plot) is None:
            raise ScenarioError(
                f"panel {self.name!r}: the experiment does not record the output {plot.name!r}; "
                "give the Experiment its outputs as y=..., shape (K, n_y)"
            )
        keys = (self.reference, self.low_signal, self.high_signal)
        for what, key in zip(("reference", "lower limit", "upper limit"), keys, strict=True):
            if key and key not in experiment.signals:
                raise ScenarioError(
                    f"panel {self.name!r}: no signal is called {key!r} to draw the {what}; "
                    f"there are {_quote(experiment.signals) or 'none'}"
                )
        return plot

    def among(self, channels: Channels, signals: Collection[str]) -> Plot:
        """Find the curve by its name.

        Args:
            channels: Available states, inputs and outputs.
            signals: Keys of the available signals.

        Raises:
            ScenarioError: If no channel or signal, or more than one, has this name, or its unit does not
                fit the panel's.
        """
        plot = plot_called(self.name, channels, signals, self.kind, what="panel")
        scale = self._scale(plot.channel.unit)
        return replace(
            plot,
            channel=self._look(plot.channel.scaled(scale)),
            scale=scale,
            reference=self.reference or plot.reference,
            low_signal=self.low_signal,
            high_signal=self.high_signal,
        )

    def _scale(self, unit: str) -> float:
        """Return the factor from a channel's unit to the panel's, unless it is given."""
        if self.scale != 1 or not self.unit or not unit:
            return self.scale
        found = conversion(unit, self.unit)
        if found is None or found.offset:  # a panel scales, but does not shift
            raise ScenarioError(
                f"panel {self.name!r}: its unit must be {unit}, or one that {unit} converts into by a "
                f"factor, got {self.unit!r}"
            )
        return found.factor

    def _check_state_is_output(self, plot: Plot, experiment: Experiment) -> None:
        """Raise ScenarioError if a state and an output share the name but differ."""
        if self.kind or plot.kind != "x":
            return
        state = _data(experiment, plot)
        for output in _of_kind("y", experiment.channels, ()):
            other = _data(experiment, output) if output.name == plot.name else None
            if state is None or other is None or np.allclose(state, other, equal_nan=True):
                continue
            raise ScenarioError(
                f"panel {self.name!r}: a state and an output have this name, and differ: "
                "rename one of them, or give kind='x' or kind='y'"
            )

    def absent(self) -> Plot:
        """Return a plot without values, for experiments that lack this curve."""
        return Plot(self._look(Channel(self.name)), "signal", self.name)

    def _look(self, channel: Channel) -> Channel:
        """Return `channel` with the attributes that this panel overrides."""
        look = ("unit", "low", "high", "target", "band", "symbol")
        given = {n: getattr(self, n) for n in look if getattr(self, n) is not None}
        try:
            return replace(channel, **given, name=self.title or channel.name)
        except ExperimentError as error:
            raise ScenarioError(f"panel {self.name!r}: {error}") from error


def plot_called(
    name: str, channels: Channels, signals: Collection[str], kind: str = "", *, what: str = "signal"
) -> Plot:
    """Find a curve by its name, or else by its symbol; without a kind, everywhere.

    `what` says what has this name, for messages.

    Raises:
        ScenarioError: If no channel or signal, or more than one, has this name.
    """
    pool = _of_kind(kind, channels, signals) if kind else plots_of(channels, signals)
    # Names first: a symbol is short, and may be the name of another channel.
    found = [p for p in pool if p.name == name] or [p for p in pool if p.channel.symbol == name]
    if len(found) == 1:
        return _with_reference(found[0], signals)
    if found:
        places = ", ".join(f"{p.kind!r}" for p in found)
        raise ScenarioError(
            f"{what} {name!r}: {len(found)} curves have this name (kind {places}): "
            "rename them, or give the kind"
        )
    there = {kind: [c.name for c in getattr(channels, kind)] for kind in ("x", "u", "y")}
    there["signal"] = list(signals)
    hint = did_you_mean(name, [each for names in there.values() for each in names])
    listed = "; ".join(f"{KINDS[k]} {_quote(names)}" for k, names in there.items() if names)
    where = f"of kind {kind!r} " if kind else ""
    raise ScenarioError(
        f"{what} {name!r}: no channel or signal {where}has this name; there are {listed or 'none'}.{hint}"
    )


def output_called(name: str, channels: Channels, signals: Collection[str] = ()) -> int:
    """Return the number of the output called `name`, from 0. Raises ScenarioError if there is none."""
    names = [channel.name for channel in channels.y]
    if name in names:
        return names.index(name)
    raise ScenarioError(
        f"no output with a reference is called {name!r}; there are {_quote(names) or 'none'}."
        f"{did_you_mean(name, names)}"
    )


def plots_of(channels: Channels, signals: Collection[str] = ()) -> tuple[Plot, ...]:
    """Return a plot for each state, input, output that is not a state, and signal, in order.

    Without states, outputs come first. An output whose reference changes is drawn with it, if the
    signal "NAME ref" holds it, as in experiments made by `recorded`.
    """
    found = [*_numbered("x", channels.x), *_numbered("u", channels.u)]
    outputs = list(_numbered("y", channels.y))
    places = {p.name: i for i, p in enumerate(found) if p.kind == "x"}
    for output in outputs:
        place, aim = places.get(output.name), output.channel
        # In another unit it is another curve, although the name is the same.
        if place is None or not same(found[place].channel.unit, aim.unit):
            found.append(output)
        elif found[place].channel.target is None:
            channel = replace(found[place].channel, target=aim.target, band=aim.band)
            found[place] = replace(found[place], channel=channel)
    if not channels.x:
        found.sort(key=lambda plot: plot.kind != "y")
    known = {p.name for p in outputs}
    found += [Plot(Channel(k), "signal", k) for k in signals if k not in known]
    return tuple(_with_reference(plot, signals) for plot in found)


def _with_reference(plot: Plot, signals: Collection[str]) -> Plot:
    """Return `plot` with the reference that `recorded` keeps as a signal, if there is one."""
    key = f"{plot.name} ref"
    return replace(plot, reference=key) if plot.kind in "xy" and key in signals else plot


def _of_kind(kind: str, channels: Channels, signals: Collection[str]) -> tuple[Plot, ...]:
    """Return every curve of one kind, including those that another kind also holds."""
    if kind == "signal":
        return tuple(Plot(Channel(name), kind, name) for name in signals)
    found = tuple(_numbered(kind, getattr(channels, kind)))
    if kind != "x":
        return found
    # States with the targets of the outputs that they also are.
    merged = {(p.name, p.nth): p for p in plots_of(channels) if p.kind == "x"}
    return tuple(merged[p.name, p.nth] for p in found)


def _numbered(kind: str, channels: Collection[Channel]) -> Iterator[Plot]:
    names: list[str] = []
    for channel in channels:
        yield Plot(channel, kind, channel.name, names.count(channel.name))
        names.append(channel.name)


def _data(experiment: Experiment, plot: Plot) -> Float[np.ndarray, " K"] | None:
    """Return the curve of `plot`, shape (K,); None if the experiment lacks it."""
    if plot.kind == "signal":
        return experiment.signals.get(plot.name)
    channels = getattr(experiment.channels, plot.kind)
    places = [i for i, channel in enumerate(channels) if channel.name == plot.name]
    if len(places) <= plot.nth:
        return None
    if plot.kind == "y":
        return experiment.output(places[plot.nth])
    array = experiment.x if plot.kind == "x" else experiment.u
    return np.asarray(array[:, places[plot.nth]])


def _quote(names: Collection[str]) -> str:
    return ", ".join(repr(name) for name in names)


MEAN = "mean"  # What the mean over all maneuvers is called: "NAME (mean)". No maneuver can have this name.


def combined(
    runs: Sequence[Experiment],
    *,
    higher_is_better: Collection[str] = (),
    targets: Mapping[str, float] | None = None,
) -> Experiment:
    """Combine the maneuvers of one θ into one experiment, which is as good as its worst maneuver.

    Each KPI that a maneuver returns is stored as "NAME (MANEUVER)". The KPI called NAME is the
    worst of all maneuvers, so the KPIs of a scenario, their limits and agents need nothing else;
    "NAME (mean)" is the mean. A KPI of one maneuver alone has no mean. If an interrupted maneuver
    lacks a KPI that others have, its worst and its mean are left out: they are unknown.

    Args:
        runs: One or more runs of the same θ, each with its own `maneuver` name.
        higher_is_better: Names of the KPIs whose smallest value is the worst.
        targets: Names of the KPIs whose worst value is the one farthest from a target, and that
            target in the KPI's unit. For all other KPIs the largest value is the worst.

    Returns:
        The first run without its maneuver name, with all maneuvers in order as its `runs`, and the
        worst end of all.

    Raises:
        ExperimentError: If there are no runs, a maneuver has no name or the name of another one,
            the runs differ in θ or in the names of their channels, a run is itself a combination,
            or no run has a KPI called as in `higher_is_better` or `targets` says, although
            none was interrupted.
    """
    targets = {} if targets is None else targets
    _check(runs)
    names = dict.fromkeys(name for run in runs for name in run.kpis)
    unknown = sorted({*higher_is_better, *targets} - set(names))
    # An interrupted run may lack the KPI that is named, so that the name need not be a mistake.
    if unknown and names and not any(run.end.interrupted for run in runs):
        raise ExperimentError(
            f"higher_is_better and targets must name KPIs of the maneuvers, got {unknown}; "
            f"there are {sorted(names)}"
        )
    badness = {name: _badness(name, higher_is_better, targets) for name in names}
    return replace(
        runs[0],
        kpis=_kpis(runs, badness),
        # As good as its worst maneuver: one that was unsafe makes the whole θ unsafe.
        end=max((run.end for run in runs), key=BEST_FIRST.index),
        runs=tuple(runs),
        maneuver="",
    )


def by_maneuver(experiment: Experiment) -> dict[str, Experiment]:
    """Return the runs of the maneuvers by name, or the experiment itself as "" if it has none.

    Other runs of one experiment are no maneuvers: they are drawn together.
    """
    if any(run.maneuver for run in experiment.runs):
        return {run.maneuver: run for run in experiment.runs}
    return {"": experiment}


def maneuvers_of(*experiments: Experiment) -> dict[str, tuple[Experiment, ...]]:
    """Return the runs of each maneuver by its name, in the order of the experiments.

    If no experiment has maneuvers, the experiments themselves are called "". One that lacks a
    maneuver, because it failed or ran before the maneuver was added, has no record there.
    """
    parts = [by_maneuver(experiment) for experiment in experiments]
    names = dict.fromkeys(name for part in parts for name in part if name) or {"": None}
    return {
        name: tuple(
            part[name] if name in part else without_record(experiment)
            for part, experiment in zip(parts, experiments, strict=True)
        )
        for name in names
    }


def without_record(experiment: Experiment) -> Experiment:
    """Return `experiment` with its θ and channels only: no instants, no KPIs, no runs."""
    nothing: dict[str, Any] = {name: getattr(experiment, name)[:0] for name in ARRAYS if name != "theta"}
    return replace(experiment, **nothing, y=None, signals={}, runs=(), kpis={})


def named(kpi: str, part: str) -> str:
    """Return the name of a KPI in one maneuver, or of its mean: "NAME (PART)"."""
    return f"{kpi} ({part})"


def _check(runs: Sequence[Experiment]) -> None:
    if not runs:
        raise ExperimentError("there must be one or more maneuvers, got none")
    for k, run in enumerate(runs):
        check_name(run.maneuver)
        if run.maneuver in [other.maneuver for other in runs[:k]]:
            raise ExperimentError(f"two maneuvers are called {run.maneuver!r}: rename one of them")
        if run.runs:
            raise ExperimentError(
                f"maneuver {run.maneuver!r} must be a single run, got a combination of {len(run.runs)} runs"
            )
        if not np.array_equal(run.theta, runs[0].theta):
            raise ExperimentError(
                f"maneuvers must run the same θ, got {runs[0].theta} in {runs[0].maneuver!r} and "
                f"{run.theta} in {run.maneuver!r}"
            )
    check_channels({run.maneuver: run.channels for run in runs})


def check_name(name: object) -> None:
    """Raise ExperimentError unless a maneuver may be called `name`."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or name == MEAN:
        raise ExperimentError(
            f"a maneuver needs a name of its own other than {MEAN!r}, such as 'step', got {name!r}"
        )


def check_channels(declared: Mapping[str, Channels]) -> None:
    """Raise ExperimentError if maneuvers differ in the names or units of their channels."""
    parts: dict[str, Callable[[Channels], object]] = {
        "states": lambda channels: [c.label for c in channels.x],
        "inputs": lambda channels: [c.label for c in channels.u],
        "outputs": lambda channels: [c.label for c in channels.y],
        "unit of time": lambda channels: channels.time_unit,
    }
    for what, part in parts.items():
        found = {name: part(channels) for name, channels in declared.items()}
        first = next(iter(found), "")
        for name in found:
            if found[name] != found[first]:
                raise ExperimentError(
                    f"maneuvers must have the same {what}, got {found[first]!r} in {first!r} and "
                    f"{found[name]!r} in {name!r}"
                )


def _badness(
    name: str, higher_is_better: Collection[str], targets: Mapping[str, float]
) -> Callable[[float], float]:
    if name in targets:
        return lambda value: abs(value - targets[name])
    return (lambda value: -value) if name in higher_is_better else (lambda value: value)


def _kpis(runs: Sequence[Experiment], badness: Mapping[str, Callable[[float], float]]) -> dict[str, float]:
    """Return the worst of each KPI, then the means, then the KPIs of each maneuver."""
    known = {
        name: [float(run.kpis[name]) for run in runs if name in run.kpis]
        for name in badness
        # What an interrupted maneuver would have had is unknown: it could be the worst of all.
        if all(name in run.kpis or not run.end.interrupted for run in runs)
    }
    # NaN is worse than any number.
    worst = {
        name: next((v for v in values if np.isnan(v)), max(values, key=badness[name]))
        for name, values in known.items()
    }
    means = {named(n, MEAN): float(np.mean(v)) for n, v in known.items() if len(v) > 1}
    each = {named(n, run.maneuver): float(v) for run in runs for n, v in run.kpis.items()}
    clashes = sorted(set(worst) & set(means | each))
    if clashes:
        raise ExperimentError(f"the KPI {clashes[0]!r} has the name of a KPI in one maneuver: rename it")
    return {**worst, **means, **each}
