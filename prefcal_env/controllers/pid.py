"""A PID controller of the standard form, as it runs in industry, and several side by side."""

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_env.knobs.knob import is_number
from prefcal_env.plants.plant import Plant

from .measured import index_of, outputs_of, reference_of
from .pid_law import PIDLaw
from .stored import as_data, finite, from_data, infinite, storable


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
        self._law = PIDLaw.of(p["K_p"], p["T_i"], p["T_d"], N=p["N"], T_s=p["T_s"])
        rule = np.sqrt(p["T_i"] * p["T_d"]) if 25 * p["T_d"] >= p["T_i"] else p["T_i"]
        self._tracking = float(rule if p["T_t"] is None else p["T_t"])
        self._integral: float | None = None
        self._derivative, self._v = 0.0, 0.0
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

    def move(self, measurement: Measurement) -> Move:
        """Decide the input; a reference that is NaN leaves it as it is."""
        r = float(reference_of(measurement)[self.output])
        if r != r:
            self._integral = None
            return Move(np.array(measurement.u, dtype=float))
        y = float(outputs_of(measurement, self._plant)[self.output])
        p, applied = self.parameters, float(measurement.u[self.input])
        if self._integral is None:  # as if at rest: r = y, with the last input
            self._r, self._y, self._derivative = y, y, 0.0
            self._integral = applied - self._proportional()
        elif np.isfinite(p["T_i"]):  # to this instant, with the input that acted since the last
            self._integral += self._law.integral * (self._r - self._y)
            self._integral += min(p["T_s"] / self._tracking, 1.0) * (applied - self._v)
        before = p["c"] * self._r - self._y
        self._r, self._y = r, y
        change = (p["c"] * r - y) - before
        self._derivative = float(self._law.pole * (self._derivative + self._law.rise * change))
        self._v = self._proportional() + self._integral + self._derivative
        u = np.array(measurement.u, dtype=float)
        u[self.input] = min(max(self._v, p["low"]), p["high"])
        return Move(u)

    def _proportional(self) -> float:
        p = self.parameters
        return float(p["K_p"] * (p["b"] * self._r - self._y))


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
