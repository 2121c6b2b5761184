"""Make an experiment of recorded curves: whatever a simulator, a logger or a table returned."""

from collections.abc import Callable, Iterable, Mapping
from itertools import starmap
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.experiments.tracking import tracking_kpis
from prefcal_env.wording import did_you_mean

from .curves import Aligned, aligned, numbers

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
    run = aligned(t, y, u, reference, signals, time_unit)
    theta = numbers("theta", np.atleast_1d(np.asarray(theta)))
    if end is None:
        end = _end(run)
    targets = [_target(r) for r in run.y_ref.T]
    steps, drawn = _steps(run), _drawn(y, targets, run)
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


def _end(run: Aligned) -> End:
    """Return why a run ended, as its curves tell."""
    if not len(run.t):
        return End.FAILED
    return End.UNSAFE if run.stopped else End.TIME_UP


def _drawn(
    names: Iterable[str], targets: Iterable[float | None], run: Aligned
) -> dict[str, Float[np.ndarray, " K"]]:
    """Return the references of outputs that change, as signals."""
    return {
        f"{name} ref": values
        for name, target, values in zip(names, targets, run.y_ref.T, strict=True)
        if target is None and np.isfinite(values).any()
    }


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
