"""Knobs: the tunable numbers θ, and the conversion between the unit cube and physical units."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.errors import KnobError

from .constraints import AnyConstraint, checked
from .ranges import exact, is_number, parts, too_close
from .resolution import default_step, nearest_step

Scale = Literal["linear", "log10"]

_ROUNDING = 1e-12  # error of decoding a proposed value, as a share of the knob's range
_TOUCHING = 1e-6  # tolerance in steps: neighbors on the grid are one step apart, up to rounding


@dataclass(frozen=True, slots=True)
class Knob:
    """A tunable number between `low` and `high`, both inclusive and in `unit`.

    Args:
        name: Name of the knob, as shown to people.
        low: Smallest value.
        high: Largest value.
        unit: Unit of both bounds.
        scale: "linear" if differences count, "log10" if ratios count.
        integer: Whether only whole numbers are valid.
        step: Resolution, in `unit`: the smallest change that a person can dial in or notice. On a
            log10 scale it is relative: 0.02 is 2 %. Proposed values are multiples of it. None
            picks a round number between 1/250 and 1/100 of the range, or 1 for an integer knob; 0
            proposes any value.
        about: One sentence that tells people what the knob does. It is ignored when knobs are
            compared, and is not saved in study files.

    Raises:
        KnobError: If the bounds are reversed, equal or infinite, lie so close that hardly a number
            fits between them, or have an infinite difference; if a log10 knob is not positive, an
            integer knob has bounds that are not integers, the name is empty, the scale is unknown,
            or the step is negative, wider than the range, or a fraction for an integer knob.
    """

    name: str
    low: float
    high: float
    unit: str = ""
    scale: Scale = "linear"
    integer: bool = False
    step: float | None = None
    about: str = field(default="", compare=False, kw_only=True)

    def __post_init__(self) -> None:
        box = f"got [{self.low}, {self.high}] {self.unit}".rstrip()
        if not (isinstance(self.name, str) and self.name.strip()):
            raise KnobError(f"a knob needs a name, got {self.name!r}")
        if not (is_number(self.low) and is_number(self.high)):
            raise KnobError(f"knob {self.name!r}: low and high must be numbers, {box}")
        if not (isfinite(self.low) and isfinite(self.high)):
            raise KnobError(f"knob {self.name!r}: low and high must be finite, {box}")
        if not self.low < self.high:
            raise KnobError(f"knob {self.name!r}: low must be below high, {box}")
        if not isfinite(float(self.high) - float(self.low)):
            raise KnobError(f"knob {self.name!r}: high minus low must be below 1.8e308, {box}")
        if too_close(float(self.low), float(self.high), integer=self.integer):
            raise KnobError(
                f"knob {self.name!r}: low and high are too close, hardly a number lies between "
                f"them, {box}: tune the distance from one of them instead"
            )
        if self.scale not in get_args(Scale):
            raise KnobError(
                f"knob {self.name!r}: scale must be one of {get_args(Scale)}, got {self.scale!r}"
            )
        if self.scale == "log10" and (self.low <= 0 or self.high / 1e300 > self.low):
            raise KnobError(f"knob {self.name!r}: a log10 scale needs low above 0, {box}")
        if self.integer and (self.low != round(self.low) or self.high != round(self.high)):
            raise KnobError(f"knob {self.name!r}: an integer knob needs integer bounds, {box}")
        if self.step is not None:
            _check_step(self, self.step)

    @property
    def resolution(self) -> float:
        """Step in use, in `unit` (relative on a log10 scale); 0 if any value may be proposed."""
        if self.step is not None:
            return float(self.step)
        return 1.0 if self.integer else default_step(self.low, self.high, self.scale)

    def round(self, value: float) -> float:
        """Return the valid proposal nearest to `value`, both in `unit`.

        Valid proposals are the multiples of the resolution (on a log10 scale `low` times a power
        of 1 + step, rounded to a few digits) and the two ends of the range.
        """
        return nearest_step(self, value)

    def steps(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return how many steps `values`, in `unit`, lie from 0 (log10: from `low`), shape (m,).

        Raises:
            KnobError: If the knob has no step.
        """
        step = self.resolution
        if step == 0:
            raise KnobError(f"knob {self.name!r} has no step to measure differences by")
        if self.scale == "log10" and not self.integer:
            return np.asarray(np.log(values / self.low) / np.log1p(step))
        return np.asarray(values / step)

    def decode(self, z: float) -> float:
        """Return the physical value, in `unit`, at `z` in [0, 1]; integers round half up."""
        if self.scale == "log10":
            value = 10.0 ** (np.log10(self.low) * (1 - z) + np.log10(self.high) * z)
        else:
            value = self.low * (1 - z) + self.high * z
        if self.integer:
            value = np.floor(value + 0.5)
        value = float(min(max(value, self.low), self.high))
        # Undo the rounding of encode and decode: a proposed value was a round number.
        nearest = value if self.integer else self.round(value)
        return nearest if abs(nearest - value) <= _ROUNDING * abs(self.high - self.low) else value

    def encode(self, value: float) -> float:
        """Return the unit coordinate in [0, 1] of a physical value in `unit`."""
        if self.scale == "log10":
            z = np.log10(value / self.low) / np.log10(self.high / self.low)
        else:
            z = (value - self.low) / (self.high - self.low)
        return float(min(max(z, 0.0), 1.0))


@dataclass(frozen=True)
class KnobSpace:
    """The search space of θ: an ordered collection of knobs, with constraints.

    Deviation: [0, 1] for each knob, where the authors' code scales to [-1, 1]; the paper names no
    box. Distances are half as long, so δ of eq. acquisition acts up to 16 times weaker. Measured
    in docs/deviations.md.

    Args:
        knobs: One or more knobs.
        constraints: Constraints that every proposed θ satisfies. `decode`, `encode` and `check`
            ignore them and know only the box, since plots also show the points outside.
        within: Maps a knob name to the physical range (low, high) that is still searched; equal
            values freeze the knob. Experiments outside this range still teach the agent.

    Raises:
        KnobError: If there are no knobs, an item is not a `Knob` or a constraint, two names are
            equal, a linear constraint names an unknown knob, or `within` does not fit the knobs.
    """

    knobs: tuple[Knob, ...]
    constraints: tuple[AnyConstraint, ...]
    within: tuple[tuple[float, float], ...]

    def __init__(
        self,
        knobs: Sequence[Knob],
        constraints: Sequence[AnyConstraint] = (),
        *,
        within: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        if isinstance(knobs, Knob) or not isinstance(knobs, Iterable):
            raise KnobError(f"a knob space needs a sequence of Knobs, got {knobs!r}")
        object.__setattr__(self, "knobs", tuple(knobs))
        strangers = [k for k in self.knobs if not isinstance(k, Knob)]
        if not self.knobs or strangers:
            raise KnobError(f"a knob space needs one or more Knobs, got {strangers or 'none'}")
        duplicates = {n for n in self.names if self.names.count(n) > 1}
        if duplicates:
            raise KnobError(f"knob names must differ, got {sorted(duplicates)} more than once")
        object.__setattr__(self, "constraints", checked(constraints, self.names))
        object.__setattr__(self, "within", parts(self.knobs, within or {}))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the knobs, in order of `knobs`."""
        return tuple(k.name for k in self.knobs)

    @property
    def frozen(self) -> tuple[bool, ...]:
        """Whether each knob is frozen at one value."""
        return tuple(low == high for low, high in self.within)

    @property
    def corners(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Lower and upper corner of the searched box in the unit cube, each of shape (n,)."""
        lower, upper = zip(*self.within, strict=True)
        return self.encode(np.array(lower)), self.encode(np.array(upper))

    def narrowed(self, within: Mapping[str, tuple[float, float]]) -> "KnobSpace":
        """Return this space with a smaller searched range; other knobs keep theirs.

        Raises:
            KnobError: If `within` does not fit the knobs, as in the constructor.
        """
        now = dict(zip(self.names, self.within, strict=True))
        return KnobSpace(self.knobs, self.constraints, within={**now, **within})

    def described(self, about: Mapping[str, str]) -> "KnobSpace":
        """Return this space with a sentence for each knob, by name, on what the knob does.

        Raises:
            KnobError: If no knob has one of the names.
        """
        unknown = sorted(set(about) - set(self.names))
        if unknown:
            raise KnobError(f"about must name some of the knobs {self.names}, got {unknown}")
        knobs = [replace(k, about=about.get(k.name, k.about)) for k in self.knobs]
        within = dict(zip(self.names, self.within, strict=True))
        return KnobSpace(knobs, self.constraints, within=within)

    def searches(self, theta: Float[np.ndarray, " n"]) -> bool:
        """Return whether a physical θ, shape (n,), lies in the searched range."""
        theta = self._vector(theta, "theta")
        return all(low <= v <= high for (low, high), v in zip(self.within, theta, strict=True))

    def __len__(self) -> int:
        return len(self.knobs)

    def __iter__(self) -> Iterator[Knob]:
        return iter(self.knobs)

    def decode(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Map a point of the unit cube, shape (n,), to physical units.

        Raises:
            KnobError: If the shape is wrong, or a coordinate is NaN or outside [0, 1].
        """
        z = self._vector(z, "z")
        for knob, zi in zip(self.knobs, z, strict=True):
            if not 0.0 <= zi <= 1.0:
                raise KnobError(f"z of knob {knob.name!r} must be in [0, 1], got {zi}")
        values = [k.decode(zi) for k, zi in zip(self.knobs, z, strict=True)]
        return np.array(
            [exact(*each) for each in zip(self.knobs, values, self.within, strict=True)]
        )

    def encode(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Map a physical θ, shape (n,), to the unit cube.

        Raises:
            KnobError: If θ is not valid, as in `check`.
        """
        theta = self.check(theta)
        return np.array([k.encode(v) for k, v in zip(self.knobs, theta, strict=True)])

    def snap(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the cube point of the θ proposed for `z`, shape (n,), with rounded knob values.

        Each knob is rounded to its resolution, unless the constraints forbid the rounded θ but
        allow the unrounded one. All `z` with the same proposed θ give the same point.
        """
        theta = self.decode(z)
        parts = zip(self.knobs, theta, self.within, strict=True)
        rounded = np.array([_rounded(*each) for each in parts])
        if self.constraints and not self.allows(rounded) and self.allows(theta):
            rounded = theta
        return self.encode(rounded)

    def close(
        self, theta: Float[np.ndarray, " n"], others: Float[np.ndarray, "m n"]
    ) -> Bool[np.ndarray, " m"]:
        """Return which of `others`, physical, are less than a step from `theta` in each knob.

        People cannot tell such experiments apart, nor dial them in. A knob without a step must be
        equal. Shape (m,).
        """
        close = np.ones(len(others), dtype=np.bool_)
        for k, knob in enumerate(self.knobs):
            if knob.resolution == 0:
                close &= others[:, k] == theta[k]
                continue
            away = np.abs(knob.steps(others[:, k]) - knob.steps(theta[k : k + 1]))
            close &= away < 1 - _TOUCHING
        return close

    def check(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return a valid physical `theta` as a float array, shape (n,).

        Raises:
            KnobError: If the shape is wrong, or a value is NaN, outside the box, or a fraction for
                an integer knob.
        """
        theta = self._vector(theta, "theta")
        for knob, value in zip(self.knobs, theta, strict=True):
            if not knob.low <= value <= knob.high:
                raise KnobError(
                    f"theta of knob {knob.name!r} must be in [{knob.low}, {knob.high}] "
                    f"{knob.unit}".rstrip()
                    + f", got {value}"
                )
            if knob.integer and value != round(value):
                raise KnobError(f"theta of knob {knob.name!r} must be an integer, got {value}")
        return theta

    def allows(self, theta: Float[np.ndarray, "*m n"]) -> Bool[np.ndarray, "*m"] | bool:
        """Return whether constraints allow a physical θ, shape (n,), or each of m, shape (m, n).

        Raises:
            KnobError: If the shape is wrong or a constraint cannot be computed.
        """
        thetas = np.asarray(theta, dtype=float)
        if thetas.ndim == 1:
            return bool(np.all(self.excess(self._vector(thetas, "theta")[None]) <= 0))
        return np.asarray(np.all(self.excess(thetas) <= 0, axis=1))

    def excess(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m c"]:
        """Return the c constraints at m physical θ, shape (m, c): 0 or less where allowed.

        Raises:
            KnobError: If the shape is wrong or a constraint cannot be computed.
        """
        if np.ndim(thetas) != 2 or np.shape(thetas)[1] != len(self):
            raise KnobError(f"thetas must have shape (m, {len(self)}), got {np.shape(thetas)}")
        if not self.constraints or not len(thetas):
            return np.zeros((len(thetas), len(self.constraints)))
        values = {name: thetas[:, k] for k, name in enumerate(self.names)}
        return np.array([constraint(values) for constraint in self.constraints]).T

    def check_allowed(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return `theta` as a float array, shape (n,), if the constraints allow it.

        Raises:
            KnobError: If θ is not valid, as in `check`, or a constraint forbids it.
        """
        theta = self.check(theta)
        for constraint, g in zip(self.constraints, self.excess(theta[None])[0], strict=True):
            if not g <= 0:
                raise KnobError(
                    f"constraint {constraint.name!r} must be 0 or less, got {g:g} at "
                    f"theta {self.named(theta)}"
                )
        return theta

    def named(self, theta: Float[np.ndarray, " n"]) -> dict[str, float]:
        """Return a dict from knob name to physical value, in order; integer knobs as int."""
        theta = self.check(theta)
        return {
            k.name: int(v) if k.integer else float(v)
            for k, v in zip(self.knobs, theta, strict=True)
        }

    def _vector(self, values: object, what: str) -> Float[np.ndarray, " n"]:
        try:
            vector = np.array(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise KnobError(f"{what} must be numbers, got {values!r}") from error
        if vector.shape != (len(self),):
            raise KnobError(
                f"{what} must have shape ({len(self)},), one value each of {self.names}, "
                f"got shape {vector.shape}"
            )
        if not np.all(np.isfinite(vector)):
            raise KnobError(
                f"{what} must be finite, got {dict(zip(self.names, vector.tolist(), strict=True))}"
            )
        return vector


def _rounded(knob: Knob, value: float, part: tuple[float, float]) -> float:
    """Return `value` rounded to the knob's resolution and kept inside the searched `part`."""
    low, high = part
    return value if value in part else float(min(max(knob.round(value), low), high))


def _check_step(knob: Knob, step: object) -> None:
    unit = "relative" if knob.scale == "log10" and not knob.integer else knob.unit
    got = f"got {step!r} {unit}".rstrip()
    if not is_number(step) or not isfinite(step) or step < 0:  # type: ignore[arg-type, operator]
        raise KnobError(f"knob {knob.name!r}: step must be a number, 0 or more, {got}")
    widest = knob.high / knob.low - 1 if unit == "relative" else knob.high - knob.low
    if step > widest:  # type: ignore[operator]
        raise KnobError(f"knob {knob.name!r}: step must be at most {widest:g}, the range, {got}")
    if knob.integer and (step < 1 or step != round(step)):  # type: ignore[operator, call-overload]
        raise KnobError(f"knob {knob.name!r}: an integer knob needs an integer step, {got}")
