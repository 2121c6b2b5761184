"""Experiments from recorded curves, with time bases of their own."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.wording import did_you_mean

_SAME_INSTANT = 1e-9  # share of the duration below which two instants count as one


@dataclass(frozen=True, slots=True)
class Curve:
    """A recorded curve up to its last finite value."""

    what: str  # what it is and its name, for messages: "output 'level'"
    t: Float[np.ndarray, " M"]  # instants, shape (M,), increasing
    values: Float[np.ndarray, " M"]  # values at `t`, shape (M,)
    # Whether a value holds until the next one, as for inputs and references; otherwise the curve is
    # interpolated linearly
    held: bool
    own: bool = False  # whether it has instants of its own
    stopped: bool = False  # whether values that are not finite followed after the last one
    gaps: bool = False  # whether values may be missing, as for signals and references

    def at(self, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
        """Return the values at other instants, shape (K,), which the curve must cover."""
        if not self.own:
            return self.values[: len(t)]
        if not self.held:
            outside = np.nan if self.gaps else None
            return np.asarray(np.interp(t, self.t, self.values, left=outside, right=outside))
        return np.asarray(self.values[np.maximum(held_rows(self.t, t), 0)])


@dataclass(frozen=True, slots=True)
class Aligned:
    """The curves of one run at common instants."""

    t: Float[np.ndarray, " K"]  # instants, shape (K,), increasing; none if no output has a finite value
    y: Float[np.ndarray, "K n_y"]  # outputs at `t`, shape (K, n_y)
    u: Float[np.ndarray, "K n_u"]  # inputs at `t`, shape (K, n_u)
    # References of the outputs at `t`, shape (K, n_y); NaN where there is none
    y_ref: Float[np.ndarray, "K n_y"]
    signals: dict[str, Float[np.ndarray, " K"]]  # additional signals by name, each of shape (K,)
    decided: Int[np.ndarray, " N"]  # rows at which inputs were decided or references changed, shape (N,)
    stopped: bool  # whether values that are not finite followed after `t`


def _align(
    t: Any,
    outputs: Mapping[str, Any],
    inputs: Mapping[str, Any],
    reference: Mapping[str, Any],
    signals: Mapping[str, Any],
    unit: str,
) -> Aligned:
    """Check the curves of a run as `recorded` does, and bring them to common instants."""
    base = None if t is None else instants_of("t", t, unit)
    curves = _curves_of("output", outputs, base, unit)
    held = _curves_of("input", inputs, base, unit, held=True)
    instants = _instants(base, curves, held, unit)
    y_ref = _table(_references(list(outputs), reference, base, instants, unit), instants)
    extra = zip(signals, _curves_of("signal", signals, base, unit, gaps=True), strict=True)
    return Aligned(
        instants,
        _table([curve.at(instants) for curve in curves], instants),
        _table([curve.at(instants) for curve in held], instants),
        y_ref,
        {name: curve.at(instants) for name, curve in extra},
        _decided(held, instants, y_ref),
        any(curve.stopped for curve in (*curves, *held)),
    )


def held_rows(instants: Float[np.ndarray, " M"], t: Float[np.ndarray, " K"]) -> Int[np.ndarray, " K"]:
    """Return the index of the last of `instants` at or before each of `t`; -1 if there is none."""
    tolerance = _SAME_INSTANT * _span(t)
    return np.asarray(np.searchsorted(instants, t + tolerance, side="right") - 1)


def bridge(
    t: Float[np.ndarray, " K"], values: Float[np.ndarray, " K"], *, held: bool
) -> Float[np.ndarray, " K"]:
    """Return `values` at `t` without gaps: interpolated, or `held` from the latest good value.

    At the ends, the nearest good value is taken. Without any good value, all stay as they are.
    """
    good = np.flatnonzero(np.isfinite(values))
    if not len(good):
        return values
    if not held:
        return np.asarray(np.interp(t, t[good], values[good]))
    latest = np.searchsorted(good, np.arange(len(values)), side="right") - 1
    return np.asarray(values[good[np.maximum(latest, 0)]])


def instants_of(name: str, t: Any, unit: str) -> Float[np.ndarray, " K"]:
    """Return anything that NumPy makes an array of as instants in `unit`, shape (K,).

    Raises:
        ExperimentError: If they are not finite numbers that increase.
    """
    found = numbers(name, t)
    wrong = np.flatnonzero(~np.isfinite(found))
    if len(wrong):
        raise ExperimentError(f"{name}[{wrong[0]}] is {found[wrong[0]]}: every instant must be one")
    back = np.flatnonzero(np.diff(found) <= 0)
    if len(back):
        k = int(back[0]) + 1
        raise ExperimentError(
            f"{name} must increase, but {name}[{k}] = {found[k]:g} {unit} comes after "
            f"{found[k - 1]:g} {unit}: sort the rows and drop duplicates, or use "
            "prefcal_env.from_frame, which can do both"
        )
    return found


def numbers(name: str, values: Any) -> Float[np.ndarray, " K"]:
    """Return `values` as an array of numbers, shape (K,).

    Raises:
        ExperimentError: If they are text, dates or a table.
    """
    given = np.asarray(values)
    if given.dtype.kind in "mM":
        raise ExperimentError(
            f"{name} must be numbers, got {given.dtype}: use prefcal_env.from_frame for time "
            "stamps, or convert them to seconds"
        )
    try:
        if np.iscomplexobj(given):  # which would lose its imaginary part
            raise TypeError("complex")
        found = given.astype(float)
    except (TypeError, ValueError) as error:
        raise ExperimentError(f"{name} must be numbers, got {given.dtype}: {error}") from error
    if found.ndim == 2 and 1 in found.shape:
        found = found.reshape(-1)  # a column or a row, as most simulators return
    if found.ndim != 1:
        raise ExperimentError(f"{name} must have shape (K,), got {found.shape}")
    return found


def _curve_of(
    what: str,
    given: Any,
    t: Float[np.ndarray, " K"] | None,
    unit: str,
    *,
    held: bool = False,
    gaps: bool = False,
) -> Curve:
    """Return the curve of the values `given` at `t`, shape (K,), or of a tuple (times, values).

    If `t` is None, every curve has its own times. Without `gaps`, it ends with its last finite
    value; `what` it is and the `unit` of time are for messages.
    """
    own = isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) > 0
    if own:
        base, values = instants_of(f"times of {what}", given[0], unit), given[1]
    elif t is not None:
        base, values = t, given
    else:
        raise ExperimentError(f"{what} needs instants: give t, or a tuple (times, values) for every curve")
    found = numbers(what, values)
    if found.shape != base.shape:
        where = "its times" if own else "t"
        raise ExperimentError(f"{what} must have shape {base.shape}, as {where}, got {found.shape}")
    first = int(np.argmax(np.isfinite(found))) if len(found) else 0
    if held and not np.isinf(found).any() and (gaps or not first):
        # Who logs changes only leaves the rest empty.
        found[first:] = bridge(base[first:], found[first:], held=True)
    kept = len(found) if gaps else _finite_rows(what, base, found, unit)
    return Curve(what, base[:kept], found[:kept], held, own, kept < len(found), gaps)


def _curves_of(
    what: str,
    given: Mapping[str, Any],
    t: Float[np.ndarray, " K"] | None,
    unit: str,
    *,
    held: bool = False,
    gaps: bool = False,
) -> list[Curve]:
    """Return the curve of each of the curves `given` by name; `what` they are is for messages."""
    return [_curve_of(f"{what} {n!r}", v, t, unit, held=held, gaps=gaps) for n, v in given.items()]


def _table(
    columns: Sequence[Float[np.ndarray, " K"]], t: Float[np.ndarray, " K"]
) -> Float[np.ndarray, "K n"]:
    """Return columns at `t` as one table, which has no column if there are none."""
    return np.stack(columns, axis=1) if len(columns) else np.zeros((len(t), 0))


def _finite_rows(what: str, t: Float[np.ndarray, " K"], values: Float[np.ndarray, " K"], unit: str) -> int:
    """Return how many rows come before the values that are not finite at the end."""
    finite = np.isfinite(values)
    if finite.all():
        return len(values)
    kept = int(np.argmin(finite))
    later = np.flatnonzero(finite[kept:])
    if len(later):
        k = kept + int(later[0])
        raise ExperimentError(
            f"{what} is {values[kept]} at index {kept} (t = {t[kept]:g} {unit}), but {values[k]:g} "
            f"at index {k}: fill the gap, or drop its rows; only the end of a run may be missing"
        )
    return kept


def _instants(
    t: Float[np.ndarray, " K"] | None, outputs: Sequence[Curve], inputs: Sequence[Curve], unit: str
) -> Float[np.ndarray, " M"]:
    """Return the instants of the experiment; none if no output has a finite value."""
    if not any(len(curve.t) for curve in outputs):
        return np.zeros(0)
    for curve in (*outputs, *inputs):
        if not len(curve.t):
            raise ExperimentError(
                f"{curve.what} begins with a value that is not finite, and others do not: "
                "leave it out, or fill it"
            )
    return _common_instants(t, [*outputs, *inputs], unit)


def _common_instants(
    t: Float[np.ndarray, " K"] | None, curves: Sequence[Curve], unit: str
) -> Float[np.ndarray, " M"]:
    """Return the instants at which every curve is known, shape (M,).

    They are those of `t`, or the union of all instants if `t` is None, up to where the first
    curve stops.
    """
    end = min((c.t[-1] for c in curves if c.stopped), default=np.inf)
    begin, union = -np.inf, t is None
    if t is None:
        begin = max(c.t[0] for c in curves)
        end = min([end, *(c.t[-1] for c in curves if not c.held)])
        if begin > end:
            late, early = (max(curves, key=lambda c: c.t[0]), min(curves, key=lambda c: c.t[-1]))
            raise ExperimentError(
                f"{early.what} ends at {early.t[-1]:g} {unit}, before {late.what} begins at "
                f"{late.t[0]:g} {unit}: bring them to one time axis"
            )
        every = np.unique(np.concatenate([c.t for c in curves]))
        # Of instants that nearly coincide, the first.
        t = every[np.diff(every, prepend=-np.inf) > _SAME_INSTANT * _span(every)]
    tolerance = _SAME_INSTANT * _span(t)
    kept = t[(t >= begin - tolerance) & (t <= end + tolerance)]
    for curve in () if union else curves:
        _check_covers(curve, kept, unit)
    return np.asarray(kept)


def _check_covers(curve: Curve, t: Float[np.ndarray, " K"], unit: str) -> None:
    """Raise ExperimentError if a curve begins after `t` begins, or ends before `t` ends."""
    if not len(t):
        return
    tolerance = _SAME_INSTANT * _span(t)
    ends_early = not curve.held and not curve.stopped and curve.t[-1] < t[-1] - tolerance
    if curve.t[0] > t[0] + tolerance or ends_early:
        raise ExperimentError(
            f"{curve.what} is recorded from {curve.t[0]:g} to {curve.t[-1]:g} {unit}, but t goes "
            f"from {t[0]:g} to {t[-1]:g} {unit}: shorten t, or give t=None to use the time that "
            "every curve covers"
        )


def _span(t: Float[np.ndarray, " K"]) -> float:
    return float(t[-1] - t[0]) if len(t) else 0.0


def _references(
    names: Sequence[str],
    given: Mapping[str, Any],
    t: Float[np.ndarray, " K"] | None,
    instants: Float[np.ndarray, " M"],
    unit: str,
) -> list[Float[np.ndarray, " M"]]:
    """Return the reference of each output at `instants`; NaN for outputs without one."""
    found = []
    for name in names:
        what, value = f"reference of {name!r}", given.get(name)
        if value is None or (not isinstance(value, tuple) and np.ndim(value) == 0):
            level = numbers(what, [np.nan if value is None else value])
            found.append(np.full(len(instants), level[0]))
        else:
            curve = _curve_of(what, value, t, unit, held=True, gaps=True)
            _check_covers(curve, instants, unit)
            found.append(curve.at(instants))
        if np.isinf(found[-1]).any():
            raise ExperimentError(f"{what} must be finite, or NaN where there is none")
    return found


def _decided(
    inputs: Sequence[Curve], t: Float[np.ndarray, " K"], y_ref: Float[np.ndarray, "K n_y"]
) -> Int[np.ndarray, " N"]:
    """Return the rows at which inputs were decided or references changed."""
    if not inputs or not all(curve.own for curve in inputs):
        return np.arange(len(t))
    # The number of the value that holds at each row: where it changes, a new one was decided.
    latest = np.stack([held_rows(curve.t, t) for curve in inputs], axis=1)
    changed = (np.diff(latest, axis=0) != 0).any(axis=1)
    changed |= (np.diff(np.nan_to_num(y_ref), axis=0) != 0).any(axis=1)
    return np.flatnonzero(np.concatenate([np.ones(min(len(t), 1), dtype=bool), changed]))


# --- Make an experiment of recorded curves: whatever a simulator, a logger or a table returned.

Limits = tuple[float | None, float | None]
_Look = tuple[Mapping[str, str], Mapping[str, Limits], Mapping[str, float]]
"""Units, limits and bands of channels by name; see `recorded`."""


def recorded(
    theta: ArrayLike,
    t: ArrayLike | None,
    outputs: Mapping[str, Any],
    inputs: Mapping[str, Any] | None = None,
    reference: Mapping[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
    limits: Mapping[str, Limits] | None = None,
    *,
    bands: Mapping[str, float] | None = None,
    signals: Mapping[str, Any] | None = None,
    kpis: Callable[[Experiment], Mapping[str, float]] | None = tracking_kpis,
    end: End | None = None,
    time_unit: str = "s",
) -> Experiment:
    """Make a complete `Experiment` of recorded curves; only θ, time and outputs are required.

    A curve is an array of values at `t`, or a tuple (times, values) with instants of its own.
    Inputs and references are held between instants, after their last one, and where they are NaN;
    outputs and signals are interpolated linearly. Before the first value of a reference, there is
    none: its output is measured from there on.

    A run that stopped may be filled up with NaN: rows are left out from the first one at which an
    output stays NaN or infinite, or an input infinite, and the run counts as `End.UNSAFE`, because a
    loop that diverges leaves such a record. Give `end=End.TIME_UP` if only the logger stopped. If no
    output ever has a finite value, the run counts as `End.FAILED` and has no record. A number of an
    output after a NaN is an error.

    If all inputs have instants of their own, the inputs count as decided at these and where a
    reference changes, so that the KPIs of their moves do not depend on how densely outputs are
    logged. Otherwise they count as decided at every instant, as in the records of a rig: moves of
    runs that were logged at the same rate can be compared.

    Args:
        theta: Controller parameters, physical, shape (n,).
        t: Instants in `time_unit`, shape (K,), increasing. None if every curve is a tuple: uses all
            of their instants in the time that every curve covers.
        outputs: Maps the name of each output to its curve.
        inputs: Maps the name of each input to its curve, held from each instant on.
        reference: Maps names of outputs to a number, or to a curve if the reference changes. A
            constant becomes the channel's target; a curve is also the signal "NAME ref".
        units: Maps names of outputs and inputs to their units.
        limits: Maps names of outputs and inputs to (low, high) in their unit; None for no limit.
        bands: Maps names of outputs to their accepted distance from the reference.
        signals: Maps names of additional signals to their curves, which may contain NaN.
        kpis: Function that returns the KPIs of the experiment by name; None for no KPIs.
        end: Why the run ended; None to conclude it from the curves.
        time_unit: Unit of time.

    Raises:
        ExperimentError: If a curve has the wrong shape, is not numeric or has a gap, instants do
            not increase, or a name is unknown. The message names the curve and the place.
    """
    y, u = _named("output", outputs), _named("input", {} if inputs is None else inputs)
    reference, signals = reference or {}, signals or {}
    look: _Look = (units or {}, limits or {}, bands or {})
    _check_names(y, u, signals, reference, look)
    run = _align(t, y, u, reference, signals, time_unit)
    theta = numbers("theta", np.atleast_1d(np.asarray(theta)))
    if end is None:
        end = End.FAILED if not len(run.t) else End.UNSAFE if run.stopped else End.TIME_UP
    targets = [_target(r) for r in run.y_ref.T]
    steps, drawn = _steps(run), _draw(y, targets, run)
    channels = _channels(u, y, targets, look, time_unit)
    made = Experiment(
        theta=theta,
        t=run.t,
        x=np.zeros((len(run.t), 0)),
        u=run.u,
        y=run.y,
        **steps,
        channels=channels,
        end=end,
        signals=drawn | run.signals,
    )
    return made if kpis is None else made.with_kpis(kpis)


def _steps(run: Aligned) -> dict[str, Any]:
    """Return what an experiment says of its N steps, in which no solver took part."""
    rows = run.decided
    return {
        "t_control": run.t[rows],
        "u_control": run.u[rows],
        "y_ref": run.y_ref[rows],
        "iterations": np.zeros(len(rows), dtype=np.int64),
        "solve_time": np.zeros(len(rows)),
        "solved": np.ones(len(rows), dtype=bool),
    }


def _draw(
    names: Iterable[str], targets: Iterable[float | None], run: Aligned
) -> dict[str, Float[np.ndarray, " K"]]:
    """Return the references of outputs that change, as signals."""
    return {
        f"{name} ref": values
        for name, target, values in zip(names, targets, run.y_ref.T, strict=True)
        if target is None and np.isfinite(values).any()
    }


def _named(what: str, given: object) -> Mapping[str, Any]:
    """Return a mapping of names to curves. Raises ExperimentError if it is something else."""
    if not isinstance(given, Mapping):
        raise ExperimentError(
            f"{what}s must be a mapping from names to curves, such as {{'level': values}}, "
            f"got {type(given).__name__}"
        )
    wrong = [name for name in given if not isinstance(name, str) or not name]
    if wrong:
        raise ExperimentError(f"the name of an {what} must be text, got {wrong[0]!r}")
    return given


def _channels(
    inputs: Iterable[str],
    outputs: Iterable[str],
    targets: Iterable[float | None],
    look: _Look,
    time_unit: str,
) -> Channels:
    """Return the channels of a run without states; a constant reference is an output's target."""
    units, limits, bands = look
    said = {name: (units.get(name, ""), *_limits(name, limits)) for name in (*inputs, *outputs)}
    u = [(name, *said[name]) for name in inputs]
    y = [(name, *said[name], target, bands.get(name)) for name, target in zip(outputs, targets, strict=True)]
    return Channels((), tuple(starmap(Channel, u)), tuple(starmap(Channel, y)), time_unit)


def _limits(name: str, limits: Mapping[str, Limits]) -> tuple[float, float]:
    between: object = limits.get(name, (None, None))
    if not isinstance(between, tuple | list) or len(between) != 2:
        raise ExperimentError(
            f"limits of {name!r} must be (low, high), with None for no limit, got {between!r}"
        )
    low, high = between
    return -np.inf if low is None else float(low), np.inf if high is None else float(high)


def _target(r: Float[np.ndarray, " K"]) -> float | None:
    """Return a reference that is constant."""
    return float(r[0]) if len(r) and np.isfinite(r[0]) and (r == r[0]).all() else None


def _check_names(
    outputs: Mapping[str, Any],
    inputs: Mapping[str, Any],
    signals: Mapping[str, Any],
    reference: Mapping[str, Any],
    look: _Look,
) -> None:
    """Refuse names that are used twice, and properties of names that do not exist."""
    if not outputs:
        raise ExperimentError("outputs must hold one curve or more, such as {'level': values}")
    names = [*outputs, *inputs, *_named("signal", signals)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ExperimentError(
            f"outputs, inputs and signals must have different names, got {twice} more than once"
        )
    properties = zip(("units", "limits", "bands", "reference"), (*look, reference), strict=True)
    for what, given in properties:
        there = [*outputs, *inputs] if what in ("units", "limits") else [*outputs]
        if not isinstance(given, Mapping):
            raise ExperimentError(
                f"{what} must be a mapping by name, such as {{{there[0]!r}: ...}}, got {type(given).__name__}"
            )
        for name in given:
            if name not in there:
                raise ExperimentError(
                    f"{what} names {name!r}; there are {', '.join(map(repr, there))}."
                    f"{did_you_mean(str(name), there)}"
                )
