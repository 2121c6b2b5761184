"""Identify a plant from a record of its input and output: a model, and others that explain it as well.

What the record leaves open is what a tuning must bear: `prefcal verify` varies the plant over the sample.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from prefcal_env.errors import RecordError

from .explained import COUNTS, FLOOR, Family, Model, Scaled, Shape, Weighed, explain, unit_responses

# --- The record as it is given: what it must be to tell anything.

_FEWEST = 30
_MOST = 1500  # rows that are used: of longer records, means over equal times
_LARGEST = 1e100  # size of numbers above which their products may overflow
_AFTER = 10  # fewest rows after the first change of the input
_SPIKE = 12.0  # times the usual change from row to row that a spike is away from the rows around it
_FLAT = 0.05  # share of the record for which an output may rest at its very highest or lowest value
_AT_REST, _UNEXPLAINED, _VISIBLE = 10, 3.0, 0.02
"""Fewest rows before the first change that show the noise; how far what is left may exceed that noise, and
the share of the response that it is at least, where a model explains the record."""
_UNCLEAR = 1.0  # largest width of the 90 % interval of the response, relative to the response
_LOAD, _SURE = 0.1, 12.0
"""Size of an unexplained step, as a share of the output's range, and by how much the logarithm of the density
must grow with it, for a record to be refused."""


def _checked(t: ArrayLike, u: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, input and output at equally spaced instants, at most `_MOST`.

    Raises:
        RecordError: If the record cannot tell anything; the message says what to do.
    """
    columns = [np.asarray(each, dtype=float) for each in (t, u, y)]
    at, u_, y_ = columns
    if not (at.ndim == 1 and at.shape == u_.shape == y_.shape):
        raise RecordError(f"t, u and y must be as long as each other, got {[c.shape for c in columns]}")
    if len(at) < _FEWEST:
        steps = np.diff(at) if len(at) > 2 else np.zeros(1)
        uneven = (
            f". They are {steps.min():g} to {steps.max():g} apart, as where a historian keeps only changes: "
            "log without its dead band and compression"
        )
        raise RecordError(
            f"a record needs {_FEWEST} rows or more to tell a model, got {len(at)}: log faster"
            + (uneven if np.ptp(steps) > np.median(steps) else "")
        )
    for name, column in zip(("time", "input", "output"), columns, strict=True):
        bad = np.flatnonzero(~np.isfinite(column))
        if len(bad):
            raise RecordError(
                f"the {name} has no value in row {bad[0] + 1} ({len(bad)} such): cut the record, or fill it"
            )
        if np.abs(column).max() > _LARGEST or 0 < np.ptp(column) < 1 / _LARGEST:
            raise RecordError(
                f"the {name} is {column.min():g} to {column.max():g}: give it in a unit in which its numbers "
                "are of usual size"
            )
    back = np.flatnonzero(np.diff(at) <= 0)
    if len(back):
        raise RecordError(f"time must increase, but does not after row {back[0] + 1}: sort the rows")
    _check_spikes(at, u_, y_)
    at, u_, y_ = _equally_spaced(at, u_, y_)
    _check_input(u_)
    _check_saturation(at, u_, y_)
    return at, u_, y_


def _check_input(u: Float[np.ndarray, " K"]) -> None:
    """Refuse an input that does not step, or too late."""
    changed = np.flatnonzero(u != u[0])
    if not len(changed):
        raise RecordError(
            f"there is no step in the input, which is {u[0]:g} throughout: step it, and log from before "
            "the step"
        )
    if len(u) - changed[0] < _AFTER:
        raise RecordError(
            f"the record is too short: it ends {len(u) - changed[0]} rows after the input first moved. "
            "Log until the output has settled, or for several dead times if it never does"
        )


def _equally_spaced(
    t: Float[np.ndarray, " K"], u: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the record at equally spaced times: inputs are held, outputs interpolated, or both averaged."""
    steps = np.diff(t)
    if np.abs(steps - steps.mean()).max() > 0.01 * steps.mean():
        count = round(min(float((t[-1] - t[0]) / np.median(steps)), 20.0 * len(t))) + 1
        at = np.linspace(t[0], t[-1], count)
        u, y = u[np.searchsorted(t, at + 1e-9 * (at[1] - at[0]), side="right") - 1], np.interp(at, t, y)
        t = at
    if (many := -(-len(t) // _MOST)) > 1:
        # Outputs are means around every instant that is kept, and inputs from it to the next one, so that
        # neither comes earlier or later.
        wide, kept = many - 1 + many % 2, np.arange(0, len(t), many)
        y = np.convolve(np.pad(y, wide // 2, mode="edge"), np.full(wide, 1 / wide), mode="valid")
        # From the first value on, so that what rests there is exactly there.
        u = u[0] + np.add.reduceat(u - u[0], kept) / np.diff(kept, append=len(u))
        t, y = t[kept], y[kept]
    return t, u, y


def _check_spikes(t: Float[np.ndarray, " K"], u: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"]) -> None:
    """Refuse up to three rows of an output between two that agree, far from both, where the input rests."""
    size = float(np.ptp(np.quantile(y, (0.05, 0.95))))
    far = max(_SPIKE * float(np.median(np.abs(np.diff(y)))), 0.2 * size)
    found = dict[int, float]()  # rows, and the value before them
    for wide in (1, 2, 3):
        a, b = y[: -wide - 1], y[wide + 1 :]
        inner = np.lib.stride_tricks.sliding_window_view(y[1:-1], wide)
        off = np.minimum(np.abs(inner - a[:, None]), np.abs(inner - b[:, None])).min(axis=1)
        # A plant that swings is as far away again soon after: around a spike, all rows agree.
        calm = _spread_around(y, wide) < far / 2
        for k in np.flatnonzero((off > far) & (off > 0) & calm).tolist():
            if np.ptp(u[max(k - 4, 0) : k + wide + 1]) == 0:
                found |= dict.fromkeys(range(k + 1, k + 1 + wide), float(y[k]))
    if found and not _describe_dead_band(y):
        first = min(found)
        rows = f"{len(found)} rows are" if len(found) > 1 else "1 row is"
        raise RecordError(
            f"the output has spikes: {rows} far from those around, the first at {t[first]:g} ({y[first]:g} "
            f"after {found[first]:.4g}). Hardly any plant moves so: delete these rows from the file, gaps "
            "are filled"
        )


def _spread_around(y: Float[np.ndarray, " K"], wide: int) -> Float[np.ndarray, " k"]:
    """Return how far up to four rows before and after each group of `wide` rows are apart."""
    padded = np.pad(y, 3, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, wide + 8)
    return np.asarray(np.ptp(np.delete(around, np.s_[4 : 4 + wide], axis=1), axis=1))


def _describe_dead_band(y: Float[np.ndarray, " K"]) -> str:
    """Return that an output mostly repeats its value and then moves far, in words; "" if it does not."""
    moves = np.abs(np.diff(y))
    still, least = int(np.sum(moves == 0)), float(np.min(moves[moves > 0], initial=np.inf))
    if 2 * still <= len(y) or not 0.02 * np.ptp(y) < least < np.inf:
        return ""
    return (
        f"the output repeats its value in {still} of {len(y)} rows and then moves by {least:.3g} or more: a "
        "dead band of the historian, or a coarse sensor. Log without dead band and compression"
    )


def _check_saturation(
    t: Float[np.ndarray, " K"], u: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"]
) -> None:
    """Refuse an output that runs into its highest or lowest value and stays there: no plant settles so."""
    size, first = float(np.ptp(y)), int(np.argmax(u != u[0]))
    near = max(3, len(y) // 50)
    for end, word in ((y.max(), "highest"), (y.min(), "lowest")):
        there = np.concatenate([[False], np.abs(y - end) <= 1e-9 * size, [False]]).astype(int)
        starts, ends = np.flatnonzero(np.diff(there) == 1), np.flatnonzero(np.diff(there) == -1)
        for start, stop in zip(starts.tolist(), ends.tolist(), strict=True):
            long = stop - start >= max(_AFTER, _FLAT * len(y))
            if long and start > first and abs(end - y[max(start - near, 0)]) > 0.05 * size:
                if held := _describe_dead_band(y):
                    raise RecordError(held)
                raise RecordError(
                    f"the output is saturated: from {t[start]:g} on it rests at {end:g}, the {word} value of "
                    "the record, which it ran into. Cut the record before, or repeat it with a smaller step"
                )


# --- Identify: weigh all families, and draw models as probable as they are.


def interval(models: Sequence[Model], name: str) -> tuple[float, float, int]:
    """Return the 90 % interval of a number over the models that have it, and how many these are."""
    values = [numbers[name] for model in models if name in (numbers := model.numbers)]
    low, high = np.quantile(values, (0.05, 0.95)).tolist()
    return low, high, len(values)


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """What a record tells of its plant."""

    models: tuple[Model, ...]  # a sample of models, those that are easiest to control first
    best: int  # number of the typical one of the most probable family
    families: Mapping[str, float]  # probability of each family, the most probable first
    t: Float[np.ndarray, " K"]  # instants at which the record was used, shape (K,)
    u: Float[np.ndarray, " K"]  # input there
    y: Float[np.ndarray, " K"]  # output there
    fit: Float[np.ndarray, " K"]  # output of the best model there, with offset and drift
    drift: float  # drift of the output over the record
    noise: float  # standard deviation of what is left
    notes: tuple[str, ...] = ()  # what to know of the record, in sentences

    @property
    def reason(self) -> str:
        """Return why the best model has the form that it has, in a sentence."""
        (first, share), *others = self.families.items()
        more = "".join(f"; {name} {100 * p:.0f} %" for name, p in others if p >= 0.05)
        said = f"{first[:1].upper()}{first[1:]}, {100 * share:.0f} % probable by how well each part of the"
        return f"{said} record is predicted from what came before it{more}."


def identify(
    t: ArrayLike, u: ArrayLike, y: ArrayLike, *, resolution: float = 0.0, count: int = 300, seed: int = 0
) -> Identified:
    """Return the models that explain a record of a plant that was at rest at its start.

    Families are weighed by the density of the record given each of them, which is the product of
    how well each row is predicted from all rows before it: so more freedom counts only if it
    predicts. All is computed in units of the record, so nothing depends on units.

    Args:
        t: Instants, shape (K,), increasing.
        u: Input from each instant to the next, shape (K,); as logged, also by a controller.
        y: Output at each instant, shape (K,).
        resolution: Resolution of the actuator in the unit of the input: it moves in steps of that.
        count: Number of models.
        seed: Seed of the sample.

    Raises:
        RecordError: If the record does not tell enough; the message says why and what to do.
    """
    t, u, y = _checked(t, u, y)
    rng, n = np.random.default_rng(seed), len(t)
    units = float(t[-1] - t[0]), float(np.ptp(u)), float(np.ptp(y))
    if not units[2]:
        raise RecordError(f"the output is {y[0]:g} throughout: does another column hold it?")
    first = int(np.argmax(u != u[0])) / (n - 1)
    scaled = Scaled(1 / (n - 1), (u - u[0]) / units[1], (y - y.mean()) / units[2], 0.9 * (1 - first))
    record, found = explain(scaled, rng)
    # Two values are rounded: the one before a step and the one after it.
    wear = resolution / np.sqrt(6) / units[1]
    drawn = rng.choice(len(found), size=count - 1, p=[each.share for each in found]).tolist()
    models = [_draw(record, found[k], units, wear, rng) for k in drawn]
    best, fit, drift = _best(record, found[0], units)
    _check_load(record, found[0], t)
    _check_told(models, units[0] * (1 - first))
    ordered, fit = _by_difficulty([best, *models], best), fit * units[2] + y.mean()
    return Identified(
        models=tuple(ordered),
        best=next(k for k, each in enumerate(ordered) if each is best),
        families={each.family.name: each.share for each in found},
        t=t,
        u=u,
        y=y,
        fit=fit,
        drift=drift * units[2],
        noise=float(np.std(y - fit)),
        notes=tuple(_notes(u, y, fit)),
    )


def _model(family: Family, shape: Shape, factors: Float[np.ndarray, " k"], units: tuple[float, ...]) -> Model:
    """Return a model in the units of the record, of the coefficients of its numerator."""
    span, of_u, of_y = units
    den = family.den(shape)
    num = factors.copy()
    if family.zero:
        num[1] *= family.scale(shape) * span
    powers = span ** np.arange(len(den) - 1, -1, -1.0)
    return Model(
        family.name,
        tuple((num[::-1] * of_y / of_u).tolist()),
        tuple((den * powers).tolist()),
        float(shape[-1]) * span,
    )


def _draw(
    record: Scaled, weighed: Weighed, units: tuple[float, ...], wear: float, rng: np.random.Generator
) -> Model:
    """Return a model drawn from those that explain the record."""
    shape = weighed.shapes[rng.choice(len(weighed.shapes), p=weighed.weights)]
    found = record.explained(weighed.family, shape)
    size = np.sqrt(found.rest / rng.chisquare(COUNTS * len(record.y)))
    own = np.linalg.solve(found.root.T, found.own + size * rng.standard_normal(len(found.own)))
    return _model(
        weighed.family, shape, own[: weighed.family.terms] * (1 + wear * rng.standard_normal()), units
    )


def _best(
    record: Scaled, found: Weighed, units: tuple[float, ...]
) -> tuple[Model, Float[np.ndarray, " K"], float]:
    """Return a family's typical model, its output in units of the record, and the drift."""
    family, shape = found.family, found.typical
    own = record.explained(family, shape).mean
    return _model(family, shape, own[: family.terms], units), own @ record.rows(family, shape), float(own[-1])


def _by_difficulty(models: Sequence[Model], best: Model) -> list[Model]:
    """Return the models by how far beyond the best one a loop tuned for that is from its limit.

    Compared are gain and phase lag at the frequency where the best model has a lag of 135 degrees.
    """
    slowest = max([*best.lags, best.delay, 1e-12])
    omega = np.geomspace(0.01, 1000, 400) / slowest
    lag = -np.unwrap(np.angle(_response(best, omega) / np.sign(best.gain)))
    place = omega[min(int(np.searchsorted(np.maximum.accumulate(lag), 0.75 * np.pi)), len(omega) - 1)]
    at = np.array([_response(model, np.array([place]))[0] for model in models])
    turned = at / at[0]
    hard = np.log(np.abs(turned)) - np.angle(turned)
    return [models[k] for k in np.argsort(hard, kind="stable").tolist()]


def _response(model: Model, omega: Float[np.ndarray, " m"]) -> np.ndarray:
    s = 1j * omega
    return np.asarray(np.polyval(model.num, s) / np.polyval(model.den, s) * np.exp(-s * model.delay))


def _check_told(models: Sequence[Model], after: float) -> None:
    """Refuse a record whose models do not agree on what the plant did within half of its time."""
    at = np.linspace(0.0, after / 2, 50)
    ends = np.array([model.step(at)[-1] for model in models])
    low, middle, high = np.quantile(ends, (0.05, 0.5, 0.95)).tolist()
    if not high - low <= _UNCLEAR * abs(middle):
        raise RecordError(
            f"the record does not tell: {after / 2:.3g} after a step of 1 of the input the output may have "
            f"moved by {low:.3g} to {high:.3g}. Log for longer, or step further than noise and "
            "loads move the output"
        )


def _check_load(record: Scaled, best: Weighed, t: Float[np.ndarray, " K"]) -> None:
    """Refuse a record in which something else moved the output, while the input did not.

    What is left is compared with steps of a load that acts through the plant's lags, or a short one.
    """
    n, moved = len(record.y), np.flatnonzero(np.diff(record.u)) + 1
    rows, found = record.rows(best.family, best.typical), [(0.0, 0)]
    before = _left(record, rows)[0]
    for start in np.linspace(0.02 * n, 0.95 * n, 60).astype(int).tolist():
        if np.any(np.abs(moved - start) < 0.04 * n):
            continue
        load = (np.arange(n) >= start).astype(float)
        for lags in (best.family.den(best.typical), np.array([0.03, 1.0])):
            acted = unit_responses(lags, 0.0, record.h, load, 1)
            left, size = _left(record, np.vstack([rows, acted]))
            if abs(size) * np.ptp(acted) > _LOAD:
                found.append((0.5 * n * np.log(before / left), start))
    better, start = max(found)
    if better > _SURE:
        raise RecordError(
            f"something else than the input moved the output from about {t[start]:.4g} on: cut the record "
            "before that, or repeat it while nothing else changes"
        )


def _left(record: Scaled, rows: Float[np.ndarray, "k K"]) -> tuple[float, float]:
    """Return the sum of squares that rows leave of a record, and the coefficient of the last one."""
    X, y = record.white(rows), record.white(record.y)
    own, *_ = np.linalg.lstsq(X.T, y, rcond=1e-10)
    left = y - own @ X
    return float(left @ left) + len(y) * FLOOR**2 * (1 - record.lasting) ** 2, float(own[-1])


def _notes(
    u: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"], fit: Float[np.ndarray, " K"]
) -> Iterator[str]:
    """Yield what to know of a record: a controller seems to act in it, or no model explains the response."""
    if np.count_nonzero(np.diff(u)) >= 0.3 * len(u):
        yield (
            "The input moves all the time, as in closed loop. That is ambiguous where the controller only "
            "answered noise and loads: trust the model only if the set point stepped, and by more than the "
            "noise."
        )
    if held := _describe_dead_band(y):
        yield f"{held[:1].upper()}{held[1:]}: until then, trust the numbers less than their intervals say."
    at_rest = y[: int(np.argmax(u != u[0]))]
    if len(at_rest) < _AT_REST:
        return
    quiet, left = float(np.std(np.diff(at_rest)) / 2**0.5), float(np.std(y - fit))
    if left > max(_UNEXPLAINED * quiet, _VISIBLE * np.ptp(fit)):
        yield (
            f"No model explains the response: what is left has a standard deviation of {left:.3g}, the noise "
            f"before the first step one of {quiet:.2g}. The actuator may stick, a load may have acted, or "
            "the plant is not linear: find out before you tune on it."
        )
