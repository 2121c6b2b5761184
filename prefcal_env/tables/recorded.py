"""Make an experiment of recorded curves: whatever a simulator, a logger or a table returned."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.experiments.rollout import computed
from prefcal_env.experiments.tracking import tracking_kpis
from prefcal_env.wording import did_you_mean

from .curves import (
    Curve,
    check_covers,
    common_instants,
    curve_of,
    curves_of,
    held_rows,
    instants_of,
    numbers,
    table,
    table_of,
)

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
    Inputs and references are held between instants and after their last one, outputs and signals
    are interpolated linearly.

    A run that stopped may be filled up with NaN: rows are left out from the first one at which an
    output or input stays NaN or infinite, and the run counts as `End.UNSAFE`, because a loop that
    diverges leaves such a record. Give `end=End.TIME_UP` if only the logger stopped. If no output
    ever has a finite value, the run counts as `End.FAILED` and has no record. A number after a
    NaN is an error.

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
    base = None if t is None else instants_of("t", t, time_unit)
    curves = curves_of("output", y, base, time_unit)
    held = curves_of("input", u, base, time_unit, held=True)
    instants = _instants(base, curves, held, time_unit)
    references = _references(list(y), reference, base, instants, time_unit)
    channel_u = tuple(_channel(name, look) for name in u)
    channel_y = tuple(_channel(name, look, r) for name, r in zip(y, references, strict=True))
    channels = Channels((), channel_u, channel_y, time_unit)
    moves = table_of(held, instants)
    made = Experiment(
        theta=_theta(theta),
        t=instants,
        x=np.zeros((len(instants), 0)),
        u=moves,
        y=table_of(curves, instants),
        **_steps(held, instants, moves, table(references, instants)),
        channels=channels,
        end=_end(instants, [*curves, *held]) if end is None else end,
        signals=_drawn(channels, references) | _extra(signals, base, instants, time_unit),
    )
    return made if kpis is None else made.with_kpis(computed(kpis, made))


def _steps(
    held: Sequence[Curve],
    t: Float[np.ndarray, " K"],
    u: Float[np.ndarray, "K n_u"],
    y_ref: Float[np.ndarray, "K n_y"],
) -> dict[str, Any]:
    """Return what an experiment says of its N steps, in which no solver took part."""
    rows = _decided(held, t, y_ref)
    return {
        "t_control": t[rows],
        "u_control": u[rows],
        "y_ref": y_ref[rows],
        "iterations": np.zeros(len(rows), dtype=np.int64),
        "solve_time": np.zeros(len(rows)),
        "solved": np.ones(len(rows), dtype=bool),
    }


def _extra(
    signals: Mapping[str, Any],
    t: Float[np.ndarray, " K"] | None,
    instants: Float[np.ndarray, " M"],
    unit: str,
) -> dict[str, Float[np.ndarray, " M"]]:
    """Return additional signals at `instants`."""
    curves = curves_of("signal", signals, t, unit, gaps=True)
    return {name: curve.at(instants) for name, curve in zip(signals, curves, strict=True)}


def _drawn(
    channels: Channels, references: Sequence[Float[np.ndarray, " K"]]
) -> dict[str, Float[np.ndarray, " K"]]:
    """Return the references that change, as signals."""
    return {
        f"{channel.name} ref": values
        for channel, values in zip(channels.y, references, strict=True)
        if channel.target is None and np.isfinite(values).any()
    }


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


def _theta(theta: ArrayLike) -> Float[np.ndarray, " n"]:
    found = numbers("theta", np.atleast_1d(np.asarray(theta)))
    if not len(found):
        raise ExperimentError("theta must have shape (n,), got (0,)")
    return found


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
    return common_instants(t, [*outputs, *inputs], unit)


def _end(instants: Float[np.ndarray, " K"], curves: Sequence[Curve]) -> End:
    """Return why a run ended, as its curves tell."""
    if not len(instants):
        return End.FAILED
    return End.UNSAFE if any(curve.stopped for curve in curves) else End.TIME_UP


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
            curve = curve_of(what, value, t, unit, held=True, gaps=True)
            check_covers(curve, instants, unit)
            found.append(curve.at(instants))
        if np.isinf(found[-1]).any():
            raise ExperimentError(f"{what} must be finite, or NaN where there is none")
    return found


def _named(what: str, given: object) -> Mapping[str, Any]:
    """Return a mapping of names to curves.

    Raises:
        ExperimentError: If it is something else.
    """
    if not isinstance(given, Mapping):
        raise ExperimentError(
            f"{what}s must be a mapping from names to curves, such as {{'level': values}}, "
            f"got {type(given).__name__}"
        )
    wrong = [name for name in given if not isinstance(name, str) or not name]
    if wrong:
        raise ExperimentError(f"the name of an {what} must be text, got {wrong[0]!r}")
    return given


def _channel(name: str, look: _Look, reference: Float[np.ndarray, " K"] | None = None) -> Channel:
    """Return a channel; a constant reference is its target."""
    units, limits, bands = look
    between: object = limits.get(name, (None, None))
    if not isinstance(between, tuple | list) or len(between) != 2:
        raise ExperimentError(
            f"limits of {name!r} must be (low, high), with None for no limit, got {between!r}"
        )
    low, high = (free if v is None else float(v) for v, free in zip(between, (-np.inf, np.inf), strict=True))
    r = np.zeros(0) if reference is None else reference
    target = float(r[0]) if len(r) and np.isfinite(r[0]) and (r == r[0]).all() else None
    return Channel(name, units.get(name, ""), low, high, target, bands.get(name))


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
