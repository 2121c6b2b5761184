"""A scenario made of nothing but a plant: its PID is tuned, everything else is found."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.margins import minimal, peak_of_sampled, sampled
from prefcal_env.controllers.pid import PID, Decentralized, LinearPIDs, Tuning, migo, simc, ziegler_nichols
from prefcal_env.errors import ScenarioError
from prefcal_env.knobs import Knob
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearSystem
from prefcal_env.units import conversion, plain
from prefcal_scenarios.scenario import Scenario

from .design import SAMPLES, Design, Single, design, settling
from .steps import Factors, name_of, plant_of, scenario_of_steps, space_of, theta_of

N = 10.0
"""Filter of the derivative part: its largest gain relative to K_p."""
_FARTHEST = 6.0  # largest ratio of a rule's gain or integral time to those of the MIGO tuning
_REACH = 5.0  # least ratio of the end of a range to its middle
_ABOUT = {
    "K_p": "Gain: a larger one reacts more strongly to errors and to noise.",
    "T_i": "Integral time: a shorter one removes lasting errors sooner, but may oscillate.",
    "T_d": "Derivative time: a longer one brakes more, and amplifies noise; 0 is off.",
    "b": "Share of the reference's step that acts at once; a small one starts gently.",
}


def pid_scenario(
    plant: Plant,
    *,
    knobs: Sequence[Knob] = (),
    reference: Mapping[str, float] | None = None,
    horizon: float | None = None,
    title: str = "",
    brief: str = "",
) -> Scenario:
    """Make the scenario of tuning a PID for `plant`: all that is not given is found.

    Found are a steady state to start from, the step of the reference, the sampling time, the
    duration, a load on the input in the second half, and ranges around the MIGO tuning that hold
    those of Skogestad and of Ziegler and Nichols where these rules apply. With several outputs,
    each gets a PID of its own, paired by the relative gain array; the references step one after
    the other.

    The knobs are K_p, T_i, T_d and the set-point weight b; with several loops they are called
    K_p_1, T_i_1 and so on. K_p is that of the controller: negative if a larger input lowers the
    output. A range of its size gets this sign.

    Source: see `prefcal_env.controllers.pid` and `described.design.pairs_of`.

    Args:
        plant: Plant, or a linear system that `Plant.of` takes.
        knobs: Knobs that replace those of the same name; K_p with the controller's sign, or its size. Times
            may be in another unit than the plant's.
        reference: Reference after the step by output, in its unit; None for the channels' targets,
            or what a fifth of the input's range achieves. Only these outputs are controlled.
        horizon: Duration of an experiment, in the plant's unit of time; None to find it.
        title: Title for headings.
        brief: Description of the task for the person who compares.

    Raises:
        ScenarioError: If there is no steady state, a name does not exist, a knob has a unit that does
            not fit the plant's, a range of K_p has the wrong sign, or no PID stabilizes the plant.
        PlantError: If `plant` is neither a plant nor a linear system.
    """
    plant = plant_of(plant, horizon)
    found = design(plant, _tuned, reference, horizon)
    made = [knob for k in range(len(found.loops)) for knob in _knobs(plant, found, k, knobs)]
    space, factors = space_of(made, [_sign_range(plant, found, knob) for knob in knobs], "PID")
    # The rules that apply to every loop.
    named = [n for n in found.loops[0].tunings if all(n in loop.tunings for loop in found.loops)]
    tunings = {name: [loop.tunings[name] for loop in found.loops] for name in named}
    references = {
        name: theta_of(space, np.ravel([(t.K_p, t.T_i, t.T_d, t.b) for t in each]) / factors)
        for name, each in tunings.items()
    }
    return scenario_of_steps(
        plant,
        found,
        PIDs.of(found, factors),
        space,
        name="pid",
        title=title or f"PID of {name_of(plant, found)}",
        references=references,
        brief=brief,
    )


@dataclass(frozen=True, slots=True, eq=False)
class PIDs:
    """Functions of θ, which holds K_p, T_i, T_d and b of each loop in turn."""

    design: Design  # what was chosen for the plant
    plant: LinearSystem  # sampled linear plant, from the inputs to the outputs of the loops
    factors: Factors  # of θ

    @classmethod
    def of(cls, found: Design, factors: Factors) -> "PIDs":
        """Return them for what was chosen for a plant."""
        rows, columns = [p.output for p in found.loops], [p.input for p in found.loops]
        delay, own = found.delay[np.ix_(rows, columns)], found.J.part(rows, columns)
        return cls(found, sampled(own.behind(found.lag), found.T_s, delay), factors)

    def around(self, plant: Plant, found: Design) -> "PIDs":
        """Return the same PIDs around another plant."""
        return PIDs.of(found, self.factors)

    def make(self, theta: Float[np.ndarray, " n"]) -> PID | Decentralized:
        """Return the controller for a physical θ, shape (n,): a PID, or one for each loop."""
        pids = [
            PID(
                t.K_p,
                t.T_i,
                t.T_d,
                T_s=self.design.T_s,
                N=N,
                b=t.b,
                low=loop.channel.low,
                high=loop.channel.high,
                output=loop.output,
                input=loop.input,
            )
            for loop, t in self._tunings(theta)
        ]
        return pids[0] if len(pids) == 1 else Decentralized(pids)

    def sensitivity(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the largest σ((1 + C G)^-1) at the inputs, infinite if the loop is unstable."""
        pids = LinearPIDs.of([tuning for _, tuning in self._tunings(theta)], N)
        if not pids.stable(self.plant)[0]:
            return np.inf
        return peak_of_sampled(lambda omega: pids.sensitivities(self.plant, omega)[0], self.plant.dt)

    def _tunings(self, theta: Float[np.ndarray, " n"]) -> list[tuple[Single, Tuning]]:
        """Return each loop with its tuning; of K_p only the size counts, see `_sign`."""
        rows = np.reshape(np.asarray(theta, dtype=float) * self.factors, (-1, 4)).tolist()
        return [
            (loop, Tuning(_sign(loop) * abs(K_p), T_i, T_d, b))
            for loop, (K_p, T_i, T_d, b) in zip(self.design.loops, rows, strict=True)
        ]


def _tuned(plant: Plant, found: Design) -> Design:
    """Return the design with tunings of its PIDs, and the loads and phases that suit them.

    Raises:
        ScenarioError: If no PID stabilizes the plant.
    """
    return replace(found, loops=tuple(_tune(plant, found, loop) for loop in found.loops))


def _tune(plant: Plant, found: Design, loop: Single) -> Single:
    i, j, T_s, channel, point = loop.output, loop.input, found.T_s, loop.channel, found.point
    model = sampled(found.J.part([i], [j]), T_s, found.delay[[i]][:, [j]])
    omega = np.geomspace(1e-4 * np.pi / T_s, 0.999 * np.pi / T_s, 400)
    # At this gain a step of the reference moves the input to its farther limit: more would saturate at once.
    largest = max(channel.high - point.u[j], point.u[j] - channel.low) / abs(loop.step)
    best = migo(model, omega, np.geomspace(2e-3, 0.25, 26) * np.pi / T_s, largest=largest)
    if best is None:
        pairs = zip(plant.states, point.x, strict=True)
        state = ", ".join(f"{c.name} = {v:.4g} {c.unit}".rstrip() for c, v in pairs)
        raise ScenarioError(
            f"no PID from {channel.name!r} to {plant.outputs[i].name!r} was found that stabilizes "
            f"plant {plant.name!r} at its steady state {state}: choose another output by its "
            f"reference, or another kind of controller{_hidden(found.J.part([i], [j]))}"
        )
    pid = LinearPIDs.of([best], N)
    M, rows = pid.loops(model)[0], np.zeros((2, len(model.A) + 2))
    # Only the output is looked at: the second row, for the input, stays 0.
    rows[0, : len(model.A)] = model.C[0]
    try:
        time, peak, _ = settling(M, pid.drive(model, best.b), rows, T_s)
    except FloatingPointError:
        time, peak = 200 * T_s, 0.0
    return replace(loop, tunings=_tunings(loop, model, omega, best)).settling(time, peak)


def _hidden(J: LinearSystem) -> str:
    """Return what to say of poles that do not decay and that the loop cannot reach; "" without any."""
    lasting, reached = (
        [rate for rate in M.rates.tolist() if rate.real >= -1e-9 * max(1.0, abs(rate))]
        for M in (J, minimal(J))
    )
    if len(lasting) <= len(reached):
        return ""
    at = ", ".join(f"{rate:.3g}".replace("+0j", "") for rate in lasting)
    return (
        f". Of the poles at s = {at} that do not decay, a zero cancels {len(lasting) - len(reached)}: the "
        "input does not move that state, or the output does not show it. Leave it out of the model"
    )


def _tunings(
    loop: Single, model: LinearSystem, omega: Float[np.ndarray, " m"], center: Tuning
) -> dict[str, Tuning]:
    """Return the MIGO tuning, and those by rules that apply, are stable and near it.

    Near means that a range around it can hold them without becoming useless.
    """
    process, T_s = loop.process, model.dt
    # Sampling delays by T_s / 2; without any dead time the rules would ask for infinite gains.
    half = replace(process, delay=max(process.delay + T_s / 2, SAMPLES / 2 * T_s))
    rules = {"SIMC": simc(half), "SIMC without T_d": simc(half, derivative=False)}
    if not process.unstable:
        rules["Ziegler-Nichols"] = ziegler_nichols(model, omega, float(np.sign(center.K_p)))
    found = {"MIGO": center}
    for name, t in rules.items():
        # T_d starts at 0, so a longer range would move its middle.
        if t is not None and t.T_d <= 2 * center.T_d:
            ratios = np.array([t.K_p / center.K_p, t.T_i / center.T_i])
            near = np.all((ratios >= 1 / _FARTHEST) & (ratios <= _FARTHEST))
            if near and LinearPIDs.of([t], N).stable(model)[0]:
                found[name] = t
    return found


def _knobs(plant: Plant, found: Design, k: int, own: Sequence[Knob]) -> list[Knob]:
    """Return K_p, T_i, T_d and b of loop k, with ranges around the MIGO tuning."""
    loop, end, time = found.loops[k], found.suffix(k), plant.time_unit
    y, u, center = plant.outputs[loop.output], loop.channel, loop.tunings["MIGO"]
    where = f"Loop {end[1:]}, {y.name} by {u.name}. " if end else ""
    about = {name: where + text for name, text in _ABOUT.items()}
    if _sign(loop) < 0:
        about["K_p"] += f" Negative, or the feedback from {y.name} to {u.name} would be positive."
    unit = _unit(u.unit, y.unit, next((knob.unit for knob in own if knob.name == f"K_p{end}"), ""))
    gain = _around([t.K_p for t in loop.tunings.values()])
    times = _around([t.T_i for t in loop.tunings.values()])
    return [
        Knob(f"K_p{end}", *gain, unit, scale="log10", about=about["K_p"]),
        Knob(f"T_i{end}", *times, time, scale="log10", about=about["T_i"]),
        Knob(f"T_d{end}", 0.0, float(f"{2 * center.T_d:.2g}"), time, about=about["T_d"]),
        Knob(f"b{end}", 0.0, 1.0, about=about["b"]),
    ]


def _unit(u: str, y: str, given: str) -> str:
    """Return the unit of K_p by those of input and output; the one that is not stated is as in `given`."""
    if not (u or y):
        return given
    parts = re.fullmatch(r"(.*)/(\(.*\)|[^/()]*)", given)
    above, below = (parts[1], parts[2].strip("()")) if parts else ("", "")
    if not u or plain(u) == "1":
        u = above if not u and above and conversion(below, y, difference=True) else "1"
    if not y:
        y = below if below and conversion(above, u) else "1"
    if plain(y) == "1":
        return "" if u == "1" else u
    return f"{u}/({y})" if set(y) & set("/ *·") else f"{u}/{y}"


def _sign(loop: Single) -> float:
    """Return the sign of K_p: that of the MIGO tuning, which alone stabilizes the loop."""
    return float(np.sign(loop.tunings["MIGO"].K_p))


def _sign_range(plant: Plant, found: Design, knob: Knob) -> Knob:
    """Return a knob that someone gave; a range of K_p gets the sign of the controller.

    Raises:
        ScenarioError: If K_p would have the other sign, or both.
    """
    loops = {f"K_p{found.suffix(k)}": loop for k, loop in enumerate(found.loops)}
    loop = loops.get(knob.name)
    if loop is None or (knob.high <= 0 if _sign(loop) < 0 else knob.low >= 0):
        return knob
    # People state sizes: a positive range of a negative gain means the same range below 0.
    if _sign(loop) < 0 <= knob.low:
        return replace(knob, low=-knob.high, high=-knob.low)
    y, u, got = plant.outputs[loop.output].name, loop.channel.name, f"{knob.low:g} to {knob.high:g}"
    raise ScenarioError(
        f"knob {knob.name!r}: K_p must be {'negative' if _sign(loop) < 0 else 'positive'} throughout, or the "
        f"feedback from {y!r} to {u!r} would be positive; got {got} {knob.unit}".rstrip()
    )


def _around(values: Sequence[float]) -> tuple[float, float]:
    """Return a range around the first value, equally wide on both sides, that holds the others."""
    middle = values[0]
    # A fifth beyond the farthest rule, so that its value is not at the very end of the range.
    reach = max([_REACH, *(1.2 * max(v / middle, middle / v) for v in values)])
    # Sorted, since a negative middle turns the ends round.
    low, high = sorted((float(f"{middle / reach:.2g}"), float(f"{middle * reach:.2g}")))
    return low, high
