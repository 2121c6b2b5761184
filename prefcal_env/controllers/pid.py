"""PID controllers: the sampled law, the controller that runs, and tuning rules."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from jaxtyping import Float, Shaped

from prefcal_env.arrays import is_number
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Measurement, Move
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearSystem

from .stored import as_data, finite, from_data, index_of, infinite, outputs_of, reference_of, storable

Rows = Shaped[np.ndarray, "p _"]

# --- The law of the sampled PID, written once: for the controller that runs and for linear loops.


@dataclass(frozen=True, slots=True)
class Tuning:
    """Parameters of a PID: gain with its sign, integral and derivative time, and set-point weight."""

    K_p: float
    T_i: float
    T_d: float = 0.0
    b: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class PIDLaw:
    """Coefficients of the sampled PID, each a number, or an array for several PIDs.

    u_k = K_p (b r_k - y_k) + I_k + D_k with I_{k+1} = I_k + integral (r_k - y_k) and
    D_k = pole (D_{k-1} + rise (e_k - e_{k-1})), where e = c r - y.
    """

    K_p: Any
    integral: Any
    pole: Any
    rise: Any

    @classmethod
    def of(cls, K_p: Any, T_i: Any, T_d: Any, *, N: float, T_s: float) -> "PIDLaw":
        """Return the law for the parameters of `PID`."""
        # K_p T_s / T_i is 0 for an infinite T_i, and the pole is 0 without a derivative.
        return cls(K_p, K_p * T_s / T_i, T_d / (T_d + N * T_s), K_p * N)

    @property
    def of_output(self) -> tuple[Any, Any]:
        """Gains of y in a form with the states I_k and s_k: the one on u, and the one on s.

        u_k = direct y_k + I_k + s_k and s_{k+1} = pole s_k + slope y_k, for r = 0.
        """
        lead = self.pole * self.rise
        return -self.K_p - lead, lead * (1 - self.pole)

    def at(self, z: Any) -> Any:
        """Return C(z), from the error to the input (c = 1), at points of the z plane."""
        direct, slope = self.of_output
        # The signs turn round: C goes from the error r - y, while `of_output` has the gains of y.
        return -direct + self.integral / (z - 1) - slope / (z - self.pole)


@dataclass(frozen=True, slots=True, eq=False)
class LinearPIDs:
    """Sets of PIDs to check together: m sets, each with p PIDs side by side.

    PID i of a set goes from output i to input i of a square plant; the parameters are as in `PID`.
    """

    K_p: Float[np.ndarray, "m p"]
    T_i: Float[np.ndarray, "m p"]
    T_d: Float[np.ndarray, "m p"]
    N: float

    @classmethod
    def of(cls, tunings: Sequence[Tuning], N: float) -> "LinearPIDs":
        """Return one set of PIDs."""
        K_p, T_i, T_d = np.array([(t.K_p, t.T_i, t.T_d) for t in tunings]).T[:, None]
        return cls(K_p, T_i, T_d, N)

    def loops(self, plant: LinearSystem) -> Float[np.ndarray, "m n n"]:
        """Return the closed loops, x⁺ = M x; x holds the plant's states, then I, then s."""
        law, p, n = self._law(plant.dt), self.K_p.shape[1], len(plant.A)
        direct, slope = law.of_output
        M = np.zeros((len(self.K_p), n + 2 * p, n + 2 * p))
        M[:, :n, :n] = plant.A + (plant.B * direct[:, None, :]) @ plant.C
        M[:, :n, n : n + p] = M[:, :n, n + p :] = plant.B
        M[:, n : n + p, :n] = -law.integral[:, :, None] * plant.C
        M[:, n + p :, :n] = slope[:, :, None] * plant.C
        k = np.arange(p)
        M[:, n + k, n + k], M[:, n + p + k, n + p + k] = 1.0, law.pole
        return M

    def drive(self, plant: LinearSystem, b: float = 1.0) -> Float[np.ndarray, "n 2"]:
        """Return what a unit step of the reference and of the load add to x, for one PID."""
        law, n = self._law(plant.dt), len(plant.A)
        drive = np.zeros((n + 2, 2))
        drive[:n] = np.column_stack([plant.B[:, 0] * b * law.K_p[0, 0], plant.B[:, 0]])
        drive[n, 0] = law.integral[0, 0]
        return drive

    def stable(self, plant: LinearSystem) -> np.ndarray:
        """Return whether all poles of each closed loop are within the unit circle, shape (m,)."""
        return np.asarray(np.abs(np.linalg.eigvals(self.loops(plant))).max(axis=1) < 1 - 1e-9)

    def peak(self, plant: LinearSystem, omega: Float[np.ndarray, " k"]) -> np.ndarray:
        """Return the larger peak of |S| and |1 - S| of sets of one PID, infinite if unstable, shape (m,)."""
        back = self._return_difference(plant, omega)[..., 0, 0]
        with np.errstate(divide="ignore"):
            peaks = (np.maximum(np.abs(back - 1), 1) / np.abs(back)).max(axis=1)
        return np.where(self.stable(plant), peaks, np.inf)

    def sensitivities(self, plant: LinearSystem, omega: Float[np.ndarray, " k"]) -> np.ndarray:
        """Return σ((1 + C G)^-1), the largest one at each of `omega`, shape (m, k).

        It is that at the inputs, as of `margins`; with one PID there is no other.

        Source: Skogestad, Postlethwaite, Multivariable Feedback Control.
        """
        back = self._return_difference(plant, omega)
        one = back.shape[-1] == 1
        least = np.abs(back[..., 0, 0]) if one else np.linalg.svd(back, compute_uv=False)[..., -1]
        with np.errstate(divide="ignore"):
            return np.asarray(1 / least)

    def _return_difference(self, plant: LinearSystem, omega: Float[np.ndarray, " k"]) -> np.ndarray:
        """Return 1 + C G at each of `omega`, shape (m, k, p, p)."""
        C = self._law(plant.dt, each=True).at(np.exp(1j * omega * plant.dt)[:, None])  # (m, k, p)
        return np.asarray(np.eye(self.K_p.shape[1]) + plant.at(1j * omega) * C[..., None])

    def _law(self, T_s: float, *, each: bool = False) -> PIDLaw:
        """Return the law of each PID, shape (m, p); with `each` for every frequency, (m, 1, p)."""
        parameters = (v[:, None] if each else v for v in (self.K_p, self.T_i, self.T_d))
        return PIDLaw.of(*parameters, N=self.N, T_s=T_s)


@storable
class PID:
    """A PID of the standard (ISA) form with two degrees of freedom, sampled.

    v = K_p (b r - y + 1/T_i ∫(r - y) dt + T_d d(c r - y)/dt), the derivative filtered with the time
    constant T_d / N, and u = v limited to [low, high].

    Sampled: P_k = K_p (b r_k - y_k); I by forward differences, I_{k+1} = I_k + K_p T_s / T_i
    (r_k - y_k) + min(T_s / T_t, 1) (u_k - v_k); D by backward differences, which are stable for
    any T_d, D_k = a D_{k-1} + a K_p N (e_k - e_{k-1}), a = T_d / (T_d + N T_s), e = c r - y.

    - Anti-windup is back-calculation with the tracking time T_t. u_k is the input that acted, read
      from the next measurement, so limits of the actuator need not be known here.
    - The start is bumpless: the integral starts as if the loop had been at rest with the last input
      and the first measured output. So the first move is K_p b (r - y).

    Source: Åström, Hägglund (2006), Advanced PID Control: filter, set-point weights,
    back-calculation with T_t = √(T_i T_d), and sampling.
    Deviation: T_t = T_i if T_d is below T_i / 25, since √(T_i T_d) would be close to 0.

    Args:
        K_p: Proportional gain, input per output; negative if a larger input lowers the output.
        T_i: Integral time, in the plant's unit of time; infinite for no integral action.
        T_d: Derivative time, in the plant's unit of time; 0 for no derivative action.
        T_s: Sampling time, in the plant's unit of time.
        N: Largest gain of the derivative relative to K_p, usually 2 to 20.
        b: Set-point weight of the proportional part; 0 removes the kick of a reference step.
        c: Set-point weight of the derivative part; 0 means derivative on measurement.
        T_t: Tracking time of the anti-windup, in the plant's unit of time; None for the rule above.
        low: Lower limit of the input.
        high: Upper limit of the input.
        output: Index or name of the measured output; a name needs `plant`.
        input: Index or name of the input; the other inputs stay as they are.
        plant: Plant whose channels are named, and whose limits replace infinite ones.

    Raises:
        SettingsError: If a parameter is not valid or a channel does not exist.
    """

    def __init__(
        self,
        K_p: float,
        T_i: float = np.inf,
        T_d: float = 0.0,
        *,
        T_s: float,
        N: float = 10.0,
        b: float = 1.0,
        c: float = 0.0,
        T_t: float | None = None,
        low: float = -np.inf,
        high: float = np.inf,
        output: int | str = 0,
        input: int | str = 0,
        plant: Plant | None = None,
    ) -> None:
        self.output = index_of(output, None if plant is None else plant.outputs, "output")
        self.input = index_of(input, None if plant is None else plant.inputs, "input")
        if plant is not None:
            channel = plant.inputs[self.input]
            low, high = max(low, channel.low), min(high, channel.high)
        self._plant = plant
        given = {"K_p": K_p, "T_i": T_i, "T_d": T_d, "T_s": T_s, "N": N, "b": b, "c": c}
        p = _checked(given | {"T_t": T_t, "low": low, "high": high})
        self.parameters: dict[str, Any] = p
        """Parameters by name, as given."""
        self.law = PIDLaw.of(p["K_p"], p["T_i"], p["T_d"], N=p["N"], T_s=p["T_s"])
        """Coefficients of the sampled law."""
        T_t = tracking_time(p["T_i"], p["T_d"]) if p["T_t"] is None else p["T_t"]
        self.tracking = min(p["T_s"] / float(T_t), 1.0)
        """Share of what the limits cut off that leaves the integral in one sampling time."""
        self._integral: float | None = None
        self._derivative, self._v, self._applied = 0.0, 0.0, 0.0
        self._r, self._y = 0.0, 0.0

    @classmethod
    def of_gains(cls, K_p: float, K_i: float = 0.0, K_d: float = 0.0, *, T_s: float, **others: Any) -> "PID":
        """Return the PID with the gains K_p, K_i = K_p / T_i and K_d = K_p T_d.

        Args:
            K_p: Proportional gain, not 0.
            K_i: Integral gain, per unit of time, of the same sign as K_p; 0 for none.
            K_d: Derivative gain, times unit of time, of the same sign as K_p.
            T_s: Sampling time, in the plant's unit of time.
            others: Other arguments of `PID`.

        Raises:
            SettingsError: If K_p is 0, the signs differ, or another argument is not valid.
        """
        if not K_p:
            raise SettingsError("PID: K_p must not be 0; for integral action alone make T_i small")
        T_i = K_p / K_i if K_i else np.inf
        return cls(K_p, T_i, K_d / K_p, T_s=T_s, **others)

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return float(self.parameters["T_s"])

    def as_data(self) -> dict[str, Any]:
        """Return channels and parameters as JSON-able data; None for infinite numbers."""
        channels = {"output": self.output, "input": self.input}
        return channels | {name: finite(value) for name, value in self.parameters.items()}

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the PID that `as_data` describes. Raises SettingsError or TypeError for other data."""
        return cls(**{name: infinite(name, value) for name, value in data.items()})

    @property
    def packed(self) -> tuple[Rows, Rows, Rows]:
        """Parameters, output and input, and memory, as a compiled episode takes them, a row each."""
        p, law = self.parameters, self.law
        numbers = [p[name] for name in ("K_p", "b", "c", "low", "high")]
        numbers += [law.integral, law.pole, law.rise, self.tracking, float(np.isfinite(p["T_i"]))]
        known, integral = self._integral is not None, self._integral or 0.0
        memory = [float(known), integral, self._derivative, self._v, self._applied, self._r, self._y]
        return np.array([numbers], dtype=float), np.array([[self.output, self.input]]), np.array([memory])

    def remember(self, memory: Rows) -> None:
        """Go on with the memory of a compiled episode, shape (1, 7)."""
        known, integral, self._derivative, self._v, self._applied, self._r, self._y = memory[0].tolist()
        self._integral = integral if known else None

    def move(self, measurement: Measurement) -> Move:
        """Decide the input; a reference that is NaN leaves it as it is."""
        r, u = float(reference_of(measurement)[self.output]), np.array(measurement.u, dtype=float)
        # Without a reference the loop is open, and an output may be missing, too.
        y = float(outputs_of(measurement, self._plant)[self.output]) if r == r else r
        u[self.input] = self.step(r, y, float(u[self.input]))
        return Move(u)

    def step(self, r: float, y: float, u: float | None = None) -> float:
        """Return the input for a reference and a measured output, once every `T_s`.

        Args:
            r: Reference; NaN leaves the input as it is.
            y: Measured output.
            u: Input that acted since the last step, by which the integral follows an actuator that did
                not follow, or a person; if left out, what `step` returned last, at first 0 within the limits.
        """
        p = self.parameters
        applied = min(max(self._applied, p["low"]), p["high"]) if u is None else u
        if r != r:  # the integral starts anew when there is a reference again
            self._integral, self._applied = None, applied
            return applied
        if self._integral is None:  # as if at rest: r = y, with the last input
            self._r, self._y, self._derivative = y, y, 0.0
            self._integral = applied - self._proportional()
        elif np.isfinite(p["T_i"]):  # to this instant, with the input that acted since the last
            self._integral += self.law.integral * (self._r - self._y)
            self._integral += self.tracking * (applied - self._v)
        # Before r and y are replaced: the derivative is of their change.
        before = p["c"] * self._r - self._y
        self._r, self._y = r, y
        change = (p["c"] * r - y) - before
        self._derivative = float(self.law.pole * (self._derivative + self.law.rise * change))
        self._v = self._proportional() + self._integral + self._derivative
        self._applied = float(min(max(self._v, p["low"]), p["high"]))
        return self._applied

    def _proportional(self) -> float:
        p = self.parameters
        return float(p["K_p"] * (p["b"] * self._r - self._y))


def tracking_time(T_i: float, T_d: float) -> float:
    """Return the tracking time of a `PID` that states none: √(T_i T_d), or T_i for little derivative."""
    return float(np.sqrt(T_i * T_d)) if 25 * T_d >= T_i else T_i


@storable
class Decentralized:
    """A `Controller` made of PIDs, each with an output and an input of its own.

    Args:
        pids: One or more PIDs with the same sampling time and different inputs.

    Raises:
        SettingsError: If there is none, sampling times differ, or two PIDs have the same input.
    """

    def __init__(self, pids: Sequence[PID]) -> None:
        self.pids = tuple(pids)
        strangers = [p for p in self.pids if not isinstance(p, PID)]
        if not self.pids or strangers:
            raise SettingsError(f"Decentralized needs one or more PIDs, got {strangers or 'none'}")
        times = sorted({p.T_s for p in self.pids})
        if len(times) > 1:
            raise SettingsError(f"Decentralized: all PIDs need the same T_s, got {times}")
        inputs = [p.input for p in self.pids]
        if len(set(inputs)) < len(inputs):
            raise SettingsError(f"Decentralized: each PID needs its own input, got {inputs}")

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self.pids[0].T_s

    def as_data(self) -> dict[str, Any]:
        """Return the PIDs as JSON-able data."""
        return {"pids": [as_data(pid) for pid in self.pids]}

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the PIDs that `as_data` describes. Raises SettingsError or KeyError for other data."""
        pids = [from_data(each) for each in data["pids"]]
        return cls([pid for pid in pids if isinstance(pid, PID)])

    @property
    def packed(self) -> tuple[Rows, Rows, Rows]:
        """Parameters, channels and memory of each PID, a row each."""
        parameters, channels, memory = (
            np.vstack(part) for part in zip(*(p.packed for p in self.pids), strict=True)
        )
        return parameters, channels, memory

    def remember(self, memory: Rows) -> None:
        """Go on with the memory of a compiled episode, shape (p, 7)."""
        for k, pid in enumerate(self.pids):
            pid.remember(memory[k : k + 1])

    def move(self, measurement: Measurement) -> Move:
        """Let each PID decide its input; inputs without a PID stay as they are."""
        u = np.array(measurement.u, dtype=float)
        for pid in self.pids:
            u[pid.input] = pid.move(measurement).u[pid.input]
        return Move(u)


def _checked(p: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters as floats; T_t may be None."""
    for name, value in p.items():
        missing = name == "T_t" and value is None
        if not missing and (not is_number(value) or value != value):
            raise SettingsError(f"PID: {name} must be a number, got {value!r}")
        if name in ("T_s", "T_i", "N", "T_t") and not missing and not value > 0:
            raise SettingsError(f"PID: {name} must be above 0, got {value}")
        if name in ("K_p", "T_d", "T_s", "N", "b", "c") and not np.isfinite(value):
            raise SettingsError(f"PID: {name} must be finite, got {value}")
    if p["T_d"] < 0:
        raise SettingsError(f"PID: T_d must be 0 or more, got {p['T_d']}")
    if not p["low"] < p["high"]:
        raise SettingsError(f"PID: low must be below high, got [{p['low']}, {p['high']}]")
    return {name: value if value is None else float(value) for name, value in p.items()}


# --- Tunings of a PID for a linear plant: by rules of the field, and by its robustness.


@dataclass(frozen=True, slots=True)
class ProcessModel:
    """What the rules need to know of a process of one input and one output."""

    gain: float  # lim s^n G(s) for s to 0, n the number of integrators
    integrators: int  # number of integrators
    lags: tuple[float, ...]  # time constants 1/|p| of the other poles, decreasing
    inverse: tuple[float, ...]  # time constants 1/z of the zeros in the right half plane
    delay: float  # dead time, with half of the sampling time
    unstable: bool = False  # whether a pole is in the right half plane
    damping: float = 1.0  # smallest damping of a pair of poles; 1 if there is none
    leads: tuple[float, ...] = ()  # time constants 1/|z| of the zeros in the left half plane


def simc(process: ProcessModel, *, derivative: bool = True) -> Tuning | None:
    """Return Skogestad's tuning with τ_c = θ; None where the rule does not apply.

    Source: Skogestad (2003), Simple analytic rules for model reduction and PID controller tuning,
    J. Process Control 13(4), 291-309: half rule, settings, and series to standard form.
    Deviation: zeros in the left half plane are left out.

    Args:
        process: Process model; not unstable, with a damping of at least 0.5.
        derivative: Whether the controller has a derivative part.
    """
    if process.unstable or process.integrators > 2 or process.damping < 0.5 or not process.gain:
        return None
    # Integrators count as the slowest lags; zeros fill up what the half rule looks at.
    lags = [np.inf] * process.integrators + list(process.lags) + [0.0] * 4
    kept = 2 if derivative else 1
    theta = process.delay + sum(process.inverse) + lags[kept] / 2 + sum(lags[kept + 1 :])
    if not 0 < theta < np.inf:
        return None
    tau = [*lags[: kept - 1], lags[kept - 1] + lags[kept] / 2]
    if process.integrators == 2:
        K, T_i, T_d = 1 / (process.gain * 16 * theta**2), 8 * theta, 8 * theta
    else:
        rate = 1 / process.gain if process.integrators else tau[0] / process.gain
        K, T_i = rate / (2 * theta), min(tau[0], 8 * theta)
        T_d = tau[1] if derivative else 0.0
    if not T_i > 0:
        return None
    # SIMC is for the series form; our PID has the standard (ISA) form.
    factor = 1 + T_d / T_i
    return Tuning(K * factor, T_i * factor, T_d / factor)


def ziegler_nichols(plant: LinearSystem, omega: Float[np.ndarray, " m"], sign: float) -> Tuning | None:
    """Return the tuning by the ultimate gain K_u and period T_u; None if there is none.

    K_p = 0.6 K_u, T_i = T_u / 2, T_d = T_u / 8.

    Source: Ziegler, Nichols (1942), Optimum settings for automatic controllers, Trans. ASME 64,
    759-768.

    The plant has one input and one output, and is stable or integrating; `omega` are increasing
    angular frequencies to search, and `sign` is that of the controller's gain.
    """
    G = sign * plant.at(1j * omega)[:, 0, 0]
    crossing = np.flatnonzero((G.imag[:-1] < 0) & (G.imag[1:] >= 0) & (G.real[1:] < 0))
    if not len(crossing):
        return None
    k = int(crossing[0])
    # Linear between two frequencies, at the crossing of the negative real axis.
    share = -G.imag[k] / (G.imag[k + 1] - G.imag[k])
    size = abs(G.real[k] + share * (G.real[k + 1] - G.real[k]))
    T_u = 2 * np.pi / (omega[k] + share * (omega[k + 1] - omega[k]))
    return Tuning(sign * 0.6 / size, T_u / 2, T_u / 8)


ROBUST = (1.6, 2.0, 2.5, 3.5, np.inf)
"""Maximum sensitivities, from the recommended range to what difficult plants allow."""


def migo(
    plant: LinearSystem,
    omega: Float[np.ndarray, " m"],
    crossover: Float[np.ndarray, " k"],
    *,
    largest: float = np.inf,
    N: float = 10.0,
) -> Tuning | None:
    """Return the MIGO tuning; None if no PID stabilizes the plant.

    It maximizes the integral gain K_p / T_i where sensitivity and complementary sensitivity are at
    most 1.6 (more only if necessary), over both signs and a grid of crossover frequencies and times.
    T_d is about a quarter of T_i at most: with a longer one the strongest integral action oscillates
    for long, though these peaks look robust. Last, the set-point weight takes off what overshoots.

    Source: Åström, Hägglund (2006), Advanced PID Control (MIGO, set-point weight); Wallén, Åström,
    Hägglund (2002), Loop-shaping design of PID controllers with constant T_i/T_d ratio, Asian J. Control 4.
    Deviation: on a grid, for the sampled loop, so any linear plant will do.

    Args:
        plant: LinearSystem plant of one input and one output.
        omega: Angular frequencies at which the sensitivity is evaluated, shape (m,).
        crossover: Crossover frequencies to try, shape (k,).
        largest: Largest |K_p|, by the input's range; ignored if nothing else is stable.
        N: Filter of the derivative, as in `PID`.
    """
    T_s = plant.dt
    # T_i and T_d times the crossover frequency; plants that are all dead time need the short T_i.
    integral, derivative = (0.18, 0.35, 0.7, 1.4, 2.8, 5.6, 11.0, 22.0), (0.05, 0.15, 0.4, 1.0, 2.0)
    shapes = [(i, d) for i in integral for d in derivative if i >= 3.5 * d]  # of the grid, the nearest to 4
    w = np.repeat(crossover, len(shapes))
    T_i, T_d = np.tile(np.array(shapes), (len(crossover), 1)).T / w
    unit = PIDLaw.of(np.ones(len(w)), T_i, T_d, N=N, T_s=T_s)
    size = np.abs(plant.at(1j * w)[:, 0, 0] * unit.at(np.exp(1j * w * T_s)))
    T_i, T_d = (np.tile(v[size > 0], 2) for v in (T_i, T_d))
    K = np.concatenate([1 / size[size > 0], -1 / size[size > 0]])  # either sign
    peak = LinearPIDs(K[:, None], T_i[:, None], T_d[:, None], N).peak(plant, omega)
    # The integral gain measures how well loads are rejected: 1/k_i is the area of the error after a step.
    drive, within = np.abs(K) / T_i, np.abs(K) <= largest
    for bound, allowed in [(b, within) for b in ROBUST] + [(np.inf, np.ones_like(within))]:
        fine = np.isfinite(peak) & (peak <= bound) & allowed
        if fine.any():
            # Among unbounded ones the most robust, else the strongest integral action.
            score = drive if np.isfinite(bound) else 1 / peak
            best = int(np.argmax(np.where(fine, score, -np.inf)))
            found = Tuning(float(K[best]), float(T_i[best]), float(T_d[best]))
            return replace(found, b=_weight(found, plant, omega, N))
    return None


def _weight(tuning: Tuning, plant: LinearSystem, omega: Float[np.ndarray, " m"], N: float) -> float:
    """Return the largest set-point weight, in tenths, with which no frequency is amplified; else 0."""
    z, weights = np.exp(1j * omega * plant.dt), np.linspace(0, 1, 11)
    law = PIDLaw.of(tuning.K_p, tuning.T_i, tuning.T_d, N=N, T_s=plant.dt)
    S = LinearPIDs.of([tuning], N).sensitivities(plant, omega)[0]
    C = weights[:, None] * law.K_p + law.integral / (z - 1)  # from the reference to the input
    peaks = (np.abs(C * plant.at(1j * omega)[:, 0, 0]) * S).max(axis=1)
    return float(weights[peaks <= 1.001].max(initial=0.0))  # 1 is where it starts, but for rounding
