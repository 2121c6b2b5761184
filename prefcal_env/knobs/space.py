"""A space of knobs: the one place where the unit cube meets physical units."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.errors import KnobError

from .constraints import AnyConstraint, checked
from .knob import Knob, is_number, too_close

_TOUCHING = 1e-6  # tolerance in steps: neighbors on the grid are one step apart, up to rounding
_NARROWEST = 1e-9  # narrowest part of a knob's range that can be searched, in the unit cube


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
    corners: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]] = field(
        init=False, repr=False, compare=False
    )
    """Lower and upper corner of the searched box in the unit cube, each of shape (n,)."""

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
        object.__setattr__(self, "within", _parts(self.knobs, within or {}))
        corners = tuple(self.encode(np.array(each)) for each in zip(*self.within, strict=True))
        for corner in corners:
            corner.flags.writeable = False
        object.__setattr__(self, "corners", corners)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the knobs, in order of `knobs`."""
        return tuple(k.name for k in self.knobs)

    @property
    def frozen(self) -> tuple[bool, ...]:
        """Whether each knob is frozen at one value."""
        return tuple(low == high for low, high in self.within)

    @property
    def integers(self) -> Bool[np.ndarray, " n"]:
        """Which knobs are integers, shape (n,)."""
        return np.array([knob.integer for knob in self.knobs], dtype=np.bool_)

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
        parts = zip(self.knobs, z, self.within, strict=True)
        return np.array([knob.exact(knob.decode(zi), part) for knob, zi, part in parts])

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
        rounded = np.array([knob.round_within(value, part) for knob, value, part in parts])
        if self.constraints and not self.allows(rounded) and self.allows(theta):
            rounded = theta
        return self.encode(rounded)

    def proposals(
        self, z: Float[np.ndarray, "m n"]
    ) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m n"]]:
        """Return many points as `snap` gives each, and their θ as `decode` does, both (m, n).

        They are the same to the last bit, since each value is computed by itself; those of
        `snap_all` and `decode_all` are not.
        """
        thetas = self._decoded(z)
        rounded = thetas.copy()
        for k, (knob, part) in enumerate(zip(self.knobs, self.within, strict=True)):
            near = np.clip(list(map(knob.round, thetas[:, k])), *part)
            rounded[:, k] = np.where(np.isin(thetas[:, k], part), thetas[:, k], near)
        if self.constraints:
            stay = ~np.atleast_1d(self.allows(rounded)) & self.allows(thetas)
            rounded[stay] = thetas[stay]
        columns = [list(map(k.encode, values)) for k, values in zip(self.knobs, rounded.T, strict=True)]
        snapped = np.array(columns).T.reshape(z.shape)
        return snapped, self._decoded(snapped)

    def _decoded(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Return θ of many points of the cube, each value as `decode` computes it, shape (m, n)."""
        thetas = np.empty(z.shape)
        for k, (knob, part) in enumerate(zip(self.knobs, self.within, strict=True)):
            thetas[:, k] = [knob.exact(knob.decode(zi), part) for zi in z[:, k]]
        return thetas

    def scaled(self, w: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Return points `w` of a unit cube, shape (m, n), scaled to the searched part."""
        lower, upper = self.corners
        return np.asarray(lower + (upper - lower) * w)

    def snap_all(
        self, z: Float[np.ndarray, "m n"], *, only_integers: bool = False
    ) -> Float[np.ndarray, "m n"]:
        """Round many points at once like `snap` without constraints, up to rounding, shape (m, n).

        Points outside the searched range move to its border.
        """
        lower, upper = self.corners
        snapped = np.asarray(np.clip(z, lower, upper))
        for k, knob in enumerate(self.knobs):
            if knob.resolution == 0 or (only_integers and not knob.integer):
                continue
            column = knob.encode_all(knob.round_all(knob.decode_all(snapped[:, k])))
            snapped[:, k] = np.clip(column, lower[k], upper[k])
        return snapped

    def decode_all(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Decode many points at once like `decode`, up to rounding, shape (m, n)."""
        thetas = np.empty(z.shape)
        for k, knob in enumerate(self.knobs):
            values = knob.decode_all(z[:, k])
            values = np.floor(values + 0.5) if knob.integer else values
            thetas[:, k] = np.clip(values, knob.low, knob.high)
        return thetas

    def encode_all(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Encode many physical θ at once like `encode`, up to rounding, shape (m, n).

        Raises:
            KnobError: If `thetas` has another shape or leaves the box.
        """
        if np.ndim(thetas) != 2 or np.shape(thetas)[1] != len(self):
            raise KnobError(f"thetas must have shape (m, {len(self)}), got {np.shape(thetas)}")
        z = np.empty(np.shape(thetas))
        inside = np.ones(len(thetas), dtype=np.bool_)
        for k, knob in enumerate(self.knobs):
            values = thetas[:, k]
            whole = values == np.round(values) if knob.integer else True
            here = (knob.low <= values) & (values <= knob.high) & whole
            inside &= here
            z[:, k] = knob.encode_all(np.where(here, values, knob.low))
        for theta in thetas[~inside][:1]:
            self.check(theta)  # says what is wrong with it
        return np.clip(z, 0.0, 1.0)

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
        for knob, value in zip(self.knobs, theta.tolist(), strict=True):
            if not knob.low <= value <= knob.high:
                raise KnobError(
                    f"theta of knob {knob.name!r} must be in [{knob.low}, {knob.high}] {knob.unit}".rstrip()
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
        return {k.name: int(v) if k.integer else float(v) for k, v in zip(self.knobs, theta, strict=True)}

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
        if not np.isfinite(vector).all():
            raise KnobError(
                f"{what} must be finite, got {dict(zip(self.names, vector.tolist(), strict=True))}"
            )
        return vector


def _parts(
    knobs: Sequence[Knob], within: Mapping[str, tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return the searched physical range of each knob, in order; by default its whole range.

    Raises:
        KnobError: If `within` names an unknown knob or a range outside the knob's range.
    """
    unknown = sorted(set(within) - {knob.name for knob in knobs})
    if unknown:
        raise KnobError(f"within must name existing knobs, got {unknown}")
    found = {knob.name: (float(knob.low), float(knob.high)) for knob in knobs}
    for knob in knobs:
        if knob.name not in within:
            continue
        low, high = within[knob.name]
        box = f"[{knob.low}, {knob.high}] {knob.unit}".rstrip()
        if not (is_number(low) and is_number(high) and knob.low <= low <= high <= knob.high):
            raise KnobError(f"knob {knob.name!r}: expected a part of {box}, got {low} to {high}")
        if knob.integer and (low != round(low) or high != round(high)):
            raise KnobError(f"knob {knob.name!r}: expected integers, got {low} to {high}")
        if low < high and (
            knob.encode(high) - knob.encode(low) < _NARROWEST
            or too_close(float(low), float(high), integer=knob.integer)
        ):
            raise KnobError(
                f"knob {knob.name!r}: {low} to {high} is too narrow to search: freeze the knob "
                "by giving the same value twice"
            )
        # Replace a border that differs from an end of the range only by rounding.
        ends = (float(knob.low), float(knob.high))
        found[knob.name] = (knob.exact(float(low), ends), knob.exact(float(high), ends))
    return tuple(found.values())
