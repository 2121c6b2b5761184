"""A scenario made of nothing but a plant: the weights of its LQR are tuned."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.lqr import LQR, Linearized, linearized
from prefcal_env.controllers.margins import peak_of_sampled, sampled
from prefcal_env.controllers.pid import ROBUST
from prefcal_env.envs.plant_env import delays_of
from prefcal_env.errors import PlantError, ScenarioError, SettingsError
from prefcal_env.knobs import Knob
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearSystem
from prefcal_scenarios.scenario import Scenario

from .design import Design, design, settling
from .steps import Factors, name_of, plant_of, scenario_of_steps, space_of, theta_of

_TIMES = (5, 10, 20, 50, 100, 200)
"""Ratios of the weights of error and integrated error to try, as times, in samples."""
_REACH = 30.0  # ratio of the end of a weight's range to its middle
_ABOUT = {
    "Q_y": "Weight of the error, as a share of the step: a larger one reacts more strongly.",
    "Q_i": "Weight of the integrated error: a larger one removes lasting errors sooner.",
    "R": "Weight of this input, as a share of its range, where the first input has 1.",
}


def lqr_scenario(
    plant: Plant,
    *,
    knobs: Sequence[Knob] = (),
    reference: Mapping[str, float] | None = None,
    horizon: float | None = None,
    title: str = "",
    brief: str = "",
) -> Scenario:
    """Make the scenario of tuning an LQR with integral action for `plant`.

    The knobs are weights: Q_y of the error and Q_i of the integrated error of each controlled
    output, and R of each input but the first; Q_i may be in another unit of time. The controller
    measures the states. The arguments, and how steps, loads, sampling time and duration are found, are
    those of `pid_scenario`; the ranges are around the fastest weights of small sensitivity.

    Raises:
        ScenarioError: If the plant has no states or no steady state, a name does not exist, or no
            LQR stabilizes the plant.
        PlantError: If `plant` is neither a plant nor a linear system.
    """
    plant = plant_of(plant, horizon)
    if not plant.states:
        raise ScenarioError(
            f"plant {plant.name!r} has no states that an LQR could feed back: tune a PID for it"
        )
    found = design(plant, _tuned, reference, horizon)
    space, factors = space_of(_knobs(plant, found), knobs, "LQR")
    return scenario_of_steps(
        plant,
        found,
        LQRs.of(plant, found, factors),
        space,
        name="lqr",
        brief=brief,
        title=title or f"LQR of {name_of(plant, found)}",
        references={"middle": theta_of(space, found.middle / factors)},
    )


@dataclass(frozen=True, slots=True, eq=False)
class LQRs:
    """Functions of θ: the LQR with these weights, and its linear loop with dead time."""

    design: Design  # what was chosen for the plant
    model: Linearized  # plant near the operating point, with the limits of the loops' inputs
    plant: LinearSystem  # sampled plant, from all inputs to all states and then the controlled outputs
    factors: Factors | float = 1.0  # of θ

    @classmethod
    def of(cls, plant: Plant, found: Design, factors: Factors | float = 1.0) -> "LQRs":
        """Return them for a plant. Raises ScenarioError if it has no continuous model."""
        point = found.point
        try:
            m = linearized(plant, point.x, point.u, point.d, found.T_s)
        except (PlantError, SettingsError) as error:
            raise ScenarioError(str(error)) from error
        low, high = m.low.copy(), m.high.copy()
        for loop in found.loops:
            low[loop.input], high[loop.input] = loop.channel.low, loop.channel.high
        return cls(found, replace(m, low=low, high=high), _whole(plant, found), factors)

    def around(self, plant: Plant, found: Design) -> "LQRs":
        """Return the same LQRs, of the same model, around another plant."""
        return replace(self, plant=_whole(plant, found))

    def make(self, theta: Float[np.ndarray, " n"]) -> LQR:
        """Return the controller for weights θ, shape (n,)."""
        m, loops = self.model, self.design.loops
        n, steps = len(loops), np.array([loop.step for loop in loops])
        theta = np.asarray(theta, dtype=float) * self.factors
        Q_y, Q_i = np.reshape(theta[: 2 * n], (n, 2)).T
        C = m.C[[loop.output for loop in loops]] / steps[:, None]
        span = np.where(np.isfinite(m.high - m.low), m.high - m.low, 1.0)
        return LQR(
            m,
            C.T @ np.diag(Q_y) @ C,
            np.array([1.0, *theta[2 * n :]]) / span**2,
            T_s=self.design.T_s,
            integral=[loop.output for loop in loops],
            Q_i=Q_i / steps**2,
        )

    def sensitivity(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the largest σ((1 + L)^-1) at the inputs, infinite if the loop is unstable."""
        if not self.radius(theta) < 1 - 1e-9:
            return np.inf
        lqr, p = self.make(theta), self.plant
        n, one = lqr.K.shape[1], np.eye(len(lqr.K))

        def sensitivities(omega: np.ndarray) -> np.ndarray:
            G, z = p.at(1j * omega), np.exp(1j * omega * p.dt)[:, None, None]
            L = lqr.K @ G[:, :n] + p.dt / (z - 1) * (lqr.K_i @ G[:, n:])
            least = np.linalg.svd(one + L, compute_uv=False)[:, -1]
            return np.asarray(1 / np.maximum(least, 1e-300))

        return peak_of_sampled(sensitivities, p.dt)

    def radius(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the spectral radius of the loop: below 1 it is stable, and a small one is fast."""
        return float(np.abs(np.linalg.eigvals(self._loop(self.make(theta))[0])).max())

    def settling(self, theta: Float[np.ndarray, " n"]) -> tuple[float, list[float], bool]:
        """Return the time until all loops have settled, peaks of unit loads, and whether u fits.

        Raises:
            FloatingPointError: If a loop does not settle.
        """
        lqr, d = self.make(theta), self.design
        M, drive, y, u = self._loop(lqr)
        times, peaks, fits = [], [], True
        for k, loop in enumerate(d.loops):
            time, peak, move = settling(M, drive[k], np.stack([y[k], u[loop.input]]), d.T_s)
            c, rest = loop.channel, d.point.u[loop.input]
            fits &= move * abs(loop.step) <= max(c.high - rest, rest - c.low)
            times.append(time)
            peaks.append(peak)
        return max(times), peaks, fits

    def _loop(self, lqr: LQR) -> tuple[np.ndarray, list[np.ndarray], np.ndarray, np.ndarray]:
        """Return M of x⁺ = M x; the drive by step and load of each loop; y and u of x."""
        p, n, n_i = self.plant, lqr.K.shape[1], len(lqr.integral)
        X, Y = p.C[:n], p.C[n:]
        u = np.hstack([-lqr.K @ X, -lqr.K_i])
        y = np.hstack([Y, np.zeros((n_i, n_i))])
        M = np.vstack([np.hstack([p.A, np.zeros((len(p.A), n_i))]) + p.B @ u, p.dt * y])
        M[len(p.A) :, len(p.A) :] += np.eye(n_i)
        drive = []
        for k, loop in enumerate(self.design.loops):
            both = np.zeros((len(M), 2))
            both[len(p.A) + k, 0], both[: len(p.A), 1] = -p.dt, p.B[:, loop.input]
            drive.append(both)
        return M, drive, y, u


def _whole(plant: Plant, found: Design) -> LinearSystem:
    """Return a sampled plant from all inputs to all states and then the controlled outputs."""
    J, outputs = found.J, [loop.output for loop in found.loops]
    C = np.vstack([np.eye(len(J.A)), J.C[outputs]])
    D = np.vstack([np.zeros(J.B.shape), J.D[outputs]])
    delay = np.vstack([np.tile(delays_of(plant)[0], (len(J.A), 1)), found.delay[outputs]])
    return sampled(LinearSystem(J.A, J.B, C, D, J.dt).behind(found.lag), found.T_s, delay)


def _tuned(plant: Plant, found: Design) -> Design:
    """Return the design with loads and phases, and the fastest weights of small sensitivity.

    If the inputs' limits allow none, the last one that settles.
    """
    loop, chosen = LQRs.of(plant, found), None
    for theta in _candidates(loop, len(plant.inputs)):
        with suppress(FloatingPointError):
            chosen = theta, *loop.settling(theta)
            if chosen[-1]:
                break
    if chosen is None:
        raise ScenarioError(
            f"no LQR was found that settles plant {plant.name!r} near its steady state: its inputs "
            "must reach all states that do not decay by themselves, and its outputs these states"
        )
    theta, time, peaks, _ = chosen
    loops = tuple(p.settling(time, peak) for p, peak in zip(found.loops, peaks, strict=True))
    return replace(found, loops=loops, middle=theta)


def _candidates(loop: LQRs, n_u: int) -> list[Float[np.ndarray, " n"]]:
    """Return the weights that give about the smallest sensitivity, the fastest decay first."""
    d = loop.design
    rated = []
    for Q_y, samples in product(np.geomspace(1e-4, 1e4, 13), _TIMES):
        Q_i = Q_y / (samples * d.T_s) ** 2
        theta = np.array([Q_y, Q_i] * len(d.loops) + [1.0] * (n_u - 1))
        try:
            peak = loop.sensitivity(theta)
        except SettingsError:
            continue
        if np.isfinite(peak):
            bound = next(b for b in ROBUST if peak <= b)
            rated.append((bound, loop.radius(theta), theta))
    least = min((bound for bound, _, _ in rated), default=0.0)
    kept = [(radius, theta) for bound, radius, theta in rated if bound == least]
    return [theta for _, theta in sorted(kept, key=lambda pair: pair[0])]


def _knobs(plant: Plant, found: Design) -> list[Knob]:
    """Return a knob for each weight, around the middle."""
    names = [f"{q}{found.suffix(k)}" for k in range(len(found.loops)) for q in ("Q_y", "Q_i")]
    names += [f"R_{j + 2}" for j in range(len(plant.inputs) - 1)]
    made = []
    for name, value in zip(names, found.middle.tolist(), strict=True):
        kind = name[:3] if name.startswith("Q") else "R"
        low, high = (float(f"{v:.2g}") for v in (value / _REACH, value * _REACH))
        unit = f"1/{plant.time_unit}²" if kind == "Q_i" else ""
        made.append(Knob(name, low, high, unit, scale="log10", about=_ABOUT[kind]))
    return made
