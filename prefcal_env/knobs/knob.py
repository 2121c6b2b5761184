"""Knobs: the tunable numbers θ, and the one place where the unit cube meets physics."""

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

_ROUNDING = 1e-12  # of decoding a proposed value, by the width of the range
_TOUCHING = 1e-6  # part of a step: neighbors on the grid are a whole step apart, up to rounding


@dataclass(frozen=True, slots=True)
class Knob:
    """One tunable number; `low` and `high` are inclusive and in `unit`.

    Args:
        name: How people call it.
        low: Smallest value.
        high: Largest value.
        unit: Of both.
        scale: Whether differences ("linear") or ratios ("log10") count.
        integer: Whether only whole numbers run.
        step: Resolution: the smallest change that a person can dial in or tell apart, in `unit`;
            on a log10 scale relative, so 0.02 is 2 %. Proposed values are multiples of it. None
            takes a round number between 1/250 and 1/100 of the range, for an integer knob 1; 0
            proposes any value.
        about: One sentence for people on what the knob does. Knobs that differ in it alone are
            equal, and no study holds it.

    Raises:
        KnobError: reversed, equal or infinite bounds, bounds with hardly a number between them or
            with an infinite difference, a log10 knob that is not positive, an integer knob without
            an integer in its range, an empty name, an unknown scale, a step that is negative or
            wider than the range, a fraction as an integer knob's step.
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
        """Step in use, in `unit` (relative on a log10 scale); 0 if every value may be proposed."""
        if self.step is not None:
            return float(self.step)
        return 1.0 if self.integer else default_step(self.low, self.high, self.scale)

    def round(self, value: float) -> float:
        """Return the value nearest to `value` that may be proposed, both in `unit`.

        That is a multiple of the resolution (on a log10 scale `low` times a power of 1 + step, to
        a few digits), or one of the two ends.
        """
        return nearest_step(self, value)

    def steps(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return how many steps `values`, in `unit`, are from 0 (log10: from `low`), shape (m,).

        Raises:
            KnobError: the knob has no step.
        """
        step = self.resolution
        if step == 0:
            raise KnobError(f"knob {self.name!r} has no step to measure differences by")
        if self.scale == "log10" and not self.integer:
            return np.asarray(np.log(values / self.low) / np.log1p(step))
        return np.asarray(values / step)

    def decode(self, z: float) -> float:
        """Physical value in `unit` of the unit coordinate `z` in [0, 1]; integers round half up."""
        if self.scale == "log10":
            value = 10.0 ** (np.log10(self.low) * (1 - z) + np.log10(self.high) * z)
        else:
            value = self.low * (1 - z) + self.high * z
        if self.integer:
            value = np.floor(value + 0.5)
        value = float(min(max(value, self.low), self.high))
        # A proposed value comes back as the round number that it is.
        nearest = value if self.integer else self.round(value)
        return nearest if abs(nearest - value) <= _ROUNDING * abs(self.high - self.low) else value

    def encode(self, value: float) -> float:
        """Unit coordinate in [0, 1] of a physical value in `unit`."""
        if self.scale == "log10":
            z = np.log10(value / self.low) / np.log10(self.high / self.low)
        else:
            z = (value - self.low) / (self.high - self.low)
        return float(min(max(z, 0.0), 1.0))


@dataclass(frozen=True)
class KnobSpace:
    """The box Θ in which θ is sought, an ordered collection of knobs.

    Deviation: [0, 1] for each knob, where the authors' code scales to [-1, 1]; the paper names no
    box. Distances are half as long, so δ of eq. acquisition acts up to 16 times weaker. Measured
    in docs/deviations.md.

    Args:
        knobs: One or more.
        constraints: What every proposed θ satisfies beside its box. `decode`, `encode` and
            `check` know the box alone, since pictures show what lies outside, too.
        within: Knob name to the (low, high) that is still searched, physical; equal: the knob is
            frozen. What lies outside stays part of the space: it was tried, and teaches.

    Raises:
        KnobError: no knob, something that is not a `Knob` or a constraint, two of one name, a
            linear constraint on a knob that is not there, or a part of a range that is none.
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
        """Names of the knobs, in order."""
        return tuple(k.name for k in self.knobs)

    @property
    def frozen(self) -> tuple[bool, ...]:
        """Which knobs have one value left."""
        return tuple(low == high for low, high in self.within)

    @property
    def corners(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Lower and upper corner, in the unit cube, of what is searched, each of shape (n,)."""
        lower, upper = zip(*self.within, strict=True)
        return self.encode(np.array(lower)), self.encode(np.array(upper))

    def narrowed(self, within: Mapping[str, tuple[float, float]]) -> "KnobSpace":
        """The same space, of which so much is searched; knobs left out stay as they are.

        Raises:
            KnobError: as the constructor.
        """
        now = dict(zip(self.names, self.within, strict=True))
        return KnobSpace(self.knobs, self.constraints, within={**now, **within})

    def described(self, about: Mapping[str, str]) -> "KnobSpace":
        """The same space, with what each knob does in a sentence, by the knob's name.

        Raises:
            KnobError: a name that no knob has.
        """
        unknown = sorted(set(about) - set(self.names))
        if unknown:
            raise KnobError(f"about must name some of the knobs {self.names}, got {unknown}")
        knobs = [replace(k, about=about.get(k.name, k.about)) for k in self.knobs]
        within = dict(zip(self.names, self.within, strict=True))
        return KnobSpace(knobs, self.constraints, within=within)

    def searches(self, theta: Float[np.ndarray, " n"]) -> bool:
        """Whether a physical θ, shape (n,), lies in what is searched."""
        theta = self._vector(theta, "theta")
        return all(low <= v <= high for (low, high), v in zip(self.within, theta, strict=True))

    def __len__(self) -> int:
        return len(self.knobs)

    def __iter__(self) -> Iterator[Knob]:
        return iter(self.knobs)

    def decode(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Map a point of the unit cube, shape (n,), to physical units.

        Raises:
            KnobError: wrong shape, NaN, or a coordinate outside [0, 1].
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
        """Map physical θ, shape (n,), to the unit cube.

        Raises:
            KnobError: as `check`.
        """
        theta = self.check(theta)
        return np.array([k.encode(v) for k, v in zip(self.knobs, theta, strict=True)])

    def snap(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the cube point of the θ that is proposed for `z`: equal for all `z` of one θ.

        Each knob is rounded to its resolution, unless the constraints refuse that θ but allow
        the one of `z` itself.
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
        """Return which of `others`, physical, differ from `theta` by less than a step in each knob.

        Nobody could tell such experiments apart, or dial them in. Without a step, equal values.
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
        """Return `theta` as a float array, shape (n,), physical.

        Raises:
            KnobError: wrong shape, NaN, outside the box, or a fraction for an integer knob.
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
        """Whether the constraints allow physical θ, shape (n,), or each of several, shape (m, n).

        Raises:
            KnobError: another shape, or a constraint that cannot be computed.
        """
        thetas = np.asarray(theta, dtype=float)
        if thetas.ndim == 1:
            return bool(np.all(self.excess(self._vector(thetas, "theta")[None]) <= 0))
        return np.asarray(np.all(self.excess(thetas) <= 0, axis=1))

    def excess(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m c"]:
        """The c constraints at physical θ, shape (m, n): 0 or less where allowed, shape (m, c).

        Raises:
            KnobError: another shape, or a constraint that cannot be computed.
        """
        if np.ndim(thetas) != 2 or np.shape(thetas)[1] != len(self):
            raise KnobError(f"thetas must have shape (m, {len(self)}), got {np.shape(thetas)}")
        if not self.constraints or not len(thetas):
            return np.zeros((len(thetas), len(self.constraints)))
        values = {name: thetas[:, k] for k, name in enumerate(self.names)}
        return np.array([constraint(values) for constraint in self.constraints]).T

    def check_allowed(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return `theta` as `check` does.

        Raises:
            KnobError: as `check`, or a constraint does not allow it.
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
        """Knob name to physical value, in order; integers as int, for people and JSON."""
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
    """`value` rounded to the knob's resolution, inside the `part` of the range that is searched."""
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
