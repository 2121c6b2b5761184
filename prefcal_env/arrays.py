"""Check the values, numbers and arrays that callers hand over, one message for each mistake; compare runs."""

from collections.abc import Mapping, Sequence
from math import comb, isfinite, isnan
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from .errors import PlantError, PrefcalError, SettingsError


def is_integer(value: object, low: float = -np.inf) -> bool:
    """Return whether `value` is an integer of Python or numpy, `low` or more; booleans are none."""
    # True is an int for Python, and a setting that is True where 1 is meant is a mistake.
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and int(value) >= low


def integer(name: str, value: Any, *, low: int, error: type[PrefcalError] = SettingsError) -> None:
    """Raise `error` unless `value` is an integer, `low` or more."""
    if not is_integer(value, low):
        raise error(f"{name} must be an integer, {low} or more, got {value!r}")


def is_number(value: object) -> bool:
    """Return whether `value` is a number of Python or numpy; booleans are not numbers."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def number(
    name: str,
    value: Any,
    *,
    low: float = 0.0,
    strict: bool = False,
    error: type[PrefcalError] = SettingsError,
) -> None:
    """Raise `error` unless `value` is finite and not below `low` (above it if strict)."""
    if not is_number(value) or not isfinite(value) or (value <= low if strict else value < low):
        relation = "above" if strict else "not below"
        raise error(f"{name} must be finite and {relation} {low:g}, got {value!r}")


def numbers(
    value: Any, what: str, error: type[PrefcalError] = SettingsError
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return `value` as an array of floats. Raises `error` unless it holds plain real numbers.

    Masked arrays have values that do not count, complex numbers have a part that would be dropped,
    and dates, strings and booleans would silently become numbers.
    """
    try:
        array = np.asarray(value)
        # i, u and f: integers with and without sign, and floats.
        plain = array.dtype.kind in "iuf" and not isinstance(value, np.ma.MaskedArray)
    except (TypeError, ValueError, RuntimeError):
        plain = False
    if not plain:
        raise error(f"{what} must be numbers, got {value!r:.120}")
    return array.astype(float)


Kind = Literal["any", "finite", "at least 0", "above 0"]


def vector(name: str, value: Any, n: int, kind: Kind = "any") -> Float[np.ndarray, " n"]:
    """Return `n` numbers as an array, shape (n,).

    Args:
        kind: What is allowed beside NaN, which never is.

    Raises:
        SettingsError: If there are more or fewer, or one is not allowed.
    """
    array = numbers(value, name)
    if array.shape != (n,) or np.isnan(array).any():
        raise SettingsError(f"{name} must hold {n} numbers, shape ({n},), got {value!r:.80}")
    fine = np.isfinite(array) | (kind == "any")
    if kind in ("at least 0", "above 0"):
        fine &= array > 0 if kind == "above 0" else array >= 0
    if not fine.all():
        more = "" if kind == "finite" else f" and {kind}"
        raise SettingsError(f"{name} must be finite{more}, got {value!r:.80}")
    return array


def matrix(name: str, value: Any, shape: tuple[int, int]) -> Float[np.ndarray, "m n"]:
    """Return the matrix that nested lists hold, of this shape. Raises SettingsError if it has another."""
    array = numbers(value, name)
    if array.size == 0 in shape:  # lists without rows have no columns
        array = np.zeros(shape)
    if array.shape != shape:
        raise SettingsError(f"{name} must have shape {shape}, got {array.shape}")
    return array


def weights(
    name: str, value: Any, n: int | None = None, *, definite: bool = False
) -> Float[np.ndarray, "n n"]:
    """Return a symmetric positive semidefinite matrix, shape (n, n); a vector is its diagonal.

    Args:
        n: Expected size; None for any.
        definite: Whether it must be positive definite.

    Raises:
        SettingsError: If it is something else.
    """
    array = numbers(value, name)
    # Without an expected size a vector may as well be a mistake.
    Q = np.diag(array) if array.ndim == 1 and n is not None else array
    shape = (n, n) if n is not None else (len(np.atleast_1d(Q)),) * 2
    if Q.shape != shape or not np.isfinite(Q).all():
        size = "" if n is None else f", shape ({n}, {n})"
        raise SettingsError(f"{name} must be a finite square matrix{size}, got {value!r:.80}")
    # A matrix of zeros is allowed, and has no scale to divide by.
    scale = max(float(np.abs(Q).max(initial=0.0)), 1e-300)
    if np.abs(Q - Q.T).max(initial=0.0) > 1e-12 * scale:
        raise SettingsError(f"{name} must be symmetric, got {Q.tolist()}")
    smallest = float(np.linalg.eigvalsh(Q).min(initial=np.inf))
    if smallest < -1e-12 * scale or (definite and smallest <= 0):
        kind = "definite" if definite else "semidefinite"
        raise SettingsError(f"{name} must be positive {kind}, its smallest eigenvalue is {smallest:.3g}")
    # Compiled functions take contiguous arrays only: any other is a type to compile for.
    return np.ascontiguousarray(Q)


# --- Checks of the values that a caller passes to an environment.


def plant_vector(value: Any, n: int, what: str, *, finite: bool = True) -> Float[np.ndarray, " n"]:
    """Return `value` as an array of shape (n,).

    Raises PlantError if it is not numeric, has the wrong shape, or is NaN or (if `finite`)
    infinite.
    """
    array = numbers(value, what, PlantError)
    if array.shape != (n,):
        raise PlantError(f"{what} must have shape ({n},), got {array.shape}")
    values = array.tolist()  # a few numbers: faster than array operations
    if not all(map(isfinite, values)) if finite else any(map(isnan, values)):
        raise PlantError(f"{what} must be finite, got {array}")
    return array


def number_in(value: Any, limits: tuple[float, float], what: str) -> float:
    """Return `value` as a float. Raises SettingsError if it is no number or outside `limits`."""
    low, high = limits
    if not is_number(value) or not low <= value <= high:
        raise SettingsError(f"{what} must be a number in [{low}, {high}], got {value!r}")
    return float(value)


def known_options(given: Mapping[str, Any] | None, known: Sequence[str]) -> dict[str, Any]:
    """Return the options of a `reset` as a dict.

    Raises SettingsError if they are no mapping, or for an unknown one.
    """
    if not isinstance(given, Mapping | None):
        raise SettingsError(f"reset options must be a dict, got {given!r}")
    options = dict(given or {})
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise SettingsError(f"reset options must be among {tuple(known)}, got {unknown}")
    return options


def holds_more(these: Bool[np.ndarray, " r"], those: Bool[np.ndarray, " r"]) -> bool:
    """Return whether one tuning holds in more of the same runs, shape (r,), than another, beyond chance.

    That is a sign test of the runs in which one of both holds and the other does not, at 5 %.
    """
    gained, lost = int(np.count_nonzero(these & ~those)), int(np.count_nonzero(those & ~these))
    count = gained + lost
    return gained > 0 and sum(comb(count, k) for k in range(gained, count + 1)) <= 0.05 * 2**count
