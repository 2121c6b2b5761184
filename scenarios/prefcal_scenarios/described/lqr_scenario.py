"""A scenario made of nothing but a plant: the weights of its LQR are tuned."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.linearized import Linearized, linearized
from prefcal_env.controllers.lqr import LQR
from prefcal_env.controllers.rules import ROBUST
from prefcal_env.controllers.sampled import Sampled, sampled
from prefcal_env.envs.dead_time import delays_of
from prefcal_env.errors import PlantError, ScenarioError, SettingsError
from prefcal_env.knobs.knob import Knob
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearSystem
from prefcal_scenarios.scenario import Scenario

from .pid.design import PATIENCE, Design, design, load_of
from .pid.knobs import replaced
from .pid.kpis import names_of
from .pid.response import settling
from .pid.steps import plant_of, scenario_of_steps

_TIMES = (5, 10, 20, 50, 100, 200)
"""Ratios of the weights of error and integrated error to try, as times, in samples."""
_REACH = 30.0
"""Ratio of the end of a weight's range to its middle."""
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
    output, and R of each input but the first. Steps, loads, sampling time and duration are found as
    `pid_scenario` does; the ranges are around the fastest robust tuning.

    Args:
        plant: Plant, or a linear system that `Plant.of` takes. The controller measures its states.
        knobs: Knobs that replace those of the same name.
        reference: Reference after the step by output, in its unit; None to find it.
        horizon: Duration of an experiment, in the plant's unit of time; None to find it.
        title: Title for headings.
        brief: Description of the task for the person who compares.

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
    centers: list[np.ndarray] = []

    def tuned(plant: Plant, found: Design) -> Design:
        made, center = _tuned(plant, found)
        centers.append(center)
        return made

    found = design(plant, tuned, reference, horizon)
    space = replaced(_knobs(plant, found, centers[-1]), knobs, "LQR")
    middle = [k.round(min(max(v, k.low), k.high)) for k, v in zip(space, centers[-1], strict=True)]
    loop = LinearLQR(MakeLQR(_model(plant, found), found), _sampled(plant, found))
    return scenario_of_steps(
        plant, found, loop.make, space, loop.sensitivity, name="lqr",
        title=title or f"LQR of {plant.name}", references={"robust": np.array(middle)}, brief=brief,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class MakeLQR:
    """Function of θ that makes the LQR."""

    model: Linearized
    design: Design

    def __call__(self, theta: Float[np.ndarray, " n"]) -> LQR:
        """Return the controller for weights θ, shape (n,)."""
        m, loops = self.model, self.design.loops
        n, steps = len(loops), np.array([loop.target - loop.start for loop in loops])
        Q_y, Q_i = np.reshape(np.asarray(theta, dtype=float)[: 2 * n], (n, 2)).T
        C = m.C[[loop.output for loop in loops]] / steps[:, None]
        span = np.where(np.isfinite(m.high - m.low), m.high - m.low, 1.0)
        return LQR(
            m, C.T @ np.diag(Q_y) @ C, np.array([1.0, *theta[2 * n :]]) / span**2,
            T_s=self.design.T_s, integral=[loop.output for loop in loops], Q_i=Q_i / steps**2,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class LinearLQR:
    """The linear loop of an LQR and the plant with its dead time.

    Args:
        make: Function of θ that makes the LQR.
        plant: Sampled plant, from all inputs to all states and then the controlled outputs.
    """

    make: MakeLQR
    plant: Sampled

    def sensitivity(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the largest σ((1 + L)^-1) at the inputs, infinite if the loop is unstable."""
        if not self.radius(theta) < 1 - 1e-9:
            return np.inf
        lqr, p = self.make(theta), self.plant
        omega = np.geomspace(1e-4, 0.999, 300) * np.pi / p.T_s
        G, z = p.at(omega), np.exp(1j * omega * p.T_s)[:, None, None]
        n = lqr.K.shape[1]
        L = lqr.K @ G[:, :n] + p.T_s / (z - 1) * (lqr.K_i @ G[:, n:])
        least = np.linalg.svd(np.eye(len(lqr.K)) + L, compute_uv=False)[:, -1].min()
        return float(1 / max(least, 1e-300))

    def radius(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the spectral radius of the loop: below 1 it is stable, and a small one is fast."""
        return float(np.abs(np.linalg.eigvals(self._loop(self.make(theta))[0])).max())

    def settling(self, theta: Float[np.ndarray, " n"]) -> tuple[float, list[float], bool]:
        """Return the time until all loops have settled, peaks of unit loads, and whether u fits.

        Raises:
            FloatingPointError: If a loop does not settle.
        """
        lqr, d = self.make(theta), self.make.design
        M, drive, y, u = self._loop(lqr)
        times, peaks, fits = [], [], True
        for k, loop in enumerate(d.loops):
            moves: list[float] = []

            def responses(count: int, k: int = k, moves: list[float] = moves) -> Any:
                x, found = np.zeros((len(M), 2)), np.zeros((count, 2))
                moves.clear()
                for i in range(count):
                    found[i] = y[k] @ x
                    moves.append(float(np.abs(u[d.loops[k].input] @ x[:, 0])))
                    x = M @ x + drive[k]
                return found[:, 0], found[:, 1]

            time, peak = settling(responses, d.T_s)
            c, rest = loop.channel, d.point.u[loop.input]
            fits &= max(moves) * abs(loop.target - loop.start) <= max(c.high - rest, rest - c.low)
            times.append(time)
            peaks.append(peak)
        return max(times), peaks, fits

    def _loop(self, lqr: LQR) -> tuple[np.ndarray, list[np.ndarray], np.ndarray, np.ndarray]:
        """Return M of x⁺ = M x; the drive by step and load of each loop; y and u of x."""
        p, n, n_i = self.plant, lqr.K.shape[1], len(lqr.integral)
        X, Y = p.C[:n], p.C[n:]
        u = np.hstack([-lqr.K @ X, -lqr.K_i])
        y = np.hstack([Y, np.zeros((n_i, n_i))])
        M = np.vstack([np.hstack([p.A, np.zeros((len(p.A), n_i))]) + p.B @ u, p.T_s * y])
        M[len(p.A) :, len(p.A) :] += np.eye(n_i)
        drive = []
        for k, loop in enumerate(self.make.design.loops):
            both = np.zeros((len(M), 2))
            both[len(p.A) + k, 0], both[: len(p.A), 1] = -p.T_s, p.B[:, loop.input]
            drive.append(both)
        return M, drive, y, u


def _tuned(plant: Plant, found: Design) -> tuple[Design, Float[np.ndarray, " n"]]:
    """Return the design with loads and phases, and the weights of the fastest robust tuning."""
    loop = LinearLQR(MakeLQR(_model(plant, found), found), _sampled(plant, found))
    chosen = None
    for theta in _candidates(loop, len(plant.inputs)):
        try:
            settled = loop.settling(theta)
        except FloatingPointError:
            continue
        chosen = theta, settled
        if settled[2]:
            break
    if chosen is None:
        raise ScenarioError(
            f"no LQR was found that settles plant {plant.name!r} near its steady state: its inputs "
            "must reach all states that do not decay by themselves, and its outputs these states"
        )
    theta, (time, peaks, _) = chosen
    loops = tuple(
        replace(s, load=load_of(s.channel, peak, abs(s.target - s.start)), phase=PATIENCE * time)
        for s, peak in zip(found.loops, peaks, strict=True)
    )
    return replace(found, loops=loops), theta


def _candidates(loop: LinearLQR, n_u: int) -> list[Float[np.ndarray, " n"]]:
    """Return the weights that give about the smallest sensitivity, the fastest decay first."""
    d = loop.make.design
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


def _model(plant: Plant, found: Design) -> Linearized:
    """Return the plant near the operating point, with the limits of the loops' inputs.

    Raises:
        ScenarioError: If a discrete plant has no continuous model.
    """
    point = found.point
    try:
        m = linearized(plant, point.x, point.u, point.d, found.T_s)
    except (PlantError, SettingsError) as error:
        raise ScenarioError(str(error)) from error
    low, high = m.low.copy(), m.high.copy()
    for loop in found.loops:
        low[loop.input], high[loop.input] = loop.channel.low, loop.channel.high
    return replace(m, low=low, high=high)


def _sampled(plant: Plant, found: Design) -> Sampled:
    """Return the plant from all inputs to all states, which are measured, and outputs."""
    J, outputs = found.J, [loop.output for loop in found.loops]
    both = LinearSystem(
        J.A, J.B, np.vstack([np.eye(len(J.A)), J.C[outputs]]),
        np.vstack([np.zeros(J.B.shape), J.D[outputs]]), J.dt,
    )  # fmt: skip
    inputs = np.tile(delays_of(plant)[0], (len(J.A), 1))
    return sampled(both, found.T_s, np.vstack([inputs, found.delay[outputs]]))


def _knobs(plant: Plant, found: Design, center: Float[np.ndarray, " n"]) -> list[Knob]:
    """Return a knob for each weight, around the middle."""
    names = [f"{q}{names_of(found, k)}" for k in range(len(found.loops)) for q in ("Q_y", "Q_i")]
    names += [f"R_{j + 2}" for j in range(len(plant.inputs) - 1)]
    made = []
    for name, value in zip(names, center.tolist(), strict=True):
        kind = name[:3] if name.startswith("Q") else "R"
        low, high = (float(f"{v:.2g}") for v in (value / _REACH, value * _REACH))
        unit = f"1/{plant.time_unit}²" if kind == "Q_i" else ""
        made.append(Knob(name, low, high, unit, scale="log10", about=_ABOUT[kind]))
    return made
