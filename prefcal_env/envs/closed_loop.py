"""Run closed-loop experiments: a controller drives an environment, as a function of θ."""

import time
from collections.abc import Callable
from dataclasses import fields, replace
from math import ceil, inf
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.utils.seeding import np_random
from jaxtyping import Bool, Float

from prefcal_env.errors import ExperimentError, PlantError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import (
    Channels,
    Controller,
    End,
    Experiment,
    KPIs,
    Measurement,
    Move,
    Record,
)
from prefcal_env.plants.function_plant import FunctionPlant
from prefcal_env.plants.jacobians import U, Y
from prefcal_env.plants.plant import Callbacks, Disturbed
from prefcal_env.plants.systems import LinearPlant
from prefcal_env.sources.source import Function, Source, Varied
from prefcal_env.wording import brief, place_in_code

from .plant_env import LITTLE, STRAIGHT, SUDDEN, PlantEnv, check_rate, dead_times, delays_of
from .task import Signal, StepSignal, Task, never
from .varied_loop import STEP, Moves, ScaledPlant, VariedLoop, Worn, moves_of

# --- Run what PIDs control in a compiled episode: as `rollout`, many times faster.

Matrix = Float[np.ndarray, "_ _"]
_LARGE = 100  # states, above which the matrices that an episode keeps take more memory than they save time
_LONGEST = 1e6  # sampling times of an episode or a dead time, up to which compiled lengths are exact


def compiled_run(env: Any, controller: Any, seed: int) -> tuple[Record, Bool[np.ndarray, " N"]] | None:
    """Return the episode and the success of each step; None for what only `rollout` can run.

    Plants are linear ones, and equations, of which a run that is stiff, fails or blows up is left to
    `rollout`, which knows what to do or to say then. Numbers differ from those of `rollout` by rounding.
    The environment itself runs no episode.

    Args:
        env: Environment, without wrappers.
        controller: Controller; its PIDs remember what they would after the episode.
        seed: Seed of the episode.
    """
    worn = controller if type(controller) is Worn else None
    pids: Any = controller if worn is None else worn.controller
    if not _are_known(pids) or type(env) is not PlantEnv or not _is_known(env, pids.T_s):
        return None
    plant, task, T_s, packed = env.plant, env.task, env.sampling_time(pids.T_s), pids.packed
    n_y, n_u = len(plant.outputs), len(plant.inputs)
    # Compiled code does not notice a channel that does not exist.
    if np.any(packed[1] >= (n_y, n_u)):
        return None
    ends, noise = _draw(task, T_s, seed, n_y)
    refs, d = _over(task.y_ref, ends[:-1]), _over(task.d, ends[:-1])
    if refs.shape != (len(d), n_y) or d.shape != (len(d), len(plant.disturbances)):
        return None
    (equations, callbacks), (offsets, acting) = _equations(plant), _acting(plant, d)
    room, found = _room(task, ends, acting, n_y)
    from ._compiled_run import PARTS, run  # loads the compiler

    steps = run(
        (_matrices(plant, T_s / PARTS), equations, offsets, acting),
        (ends, float(task.dense_step)),
        (refs, noise),
        _delays(plant, task),
        _limits(plant, task),
        # A discrete plant sees nothing between its samples.
        (float(task.lag), (inf if getattr(plant, "sample_time", 0.0) else STRAIGHT, SUDDEN, LITTLE)),
        packed,
        _wear(worn, n_y, n_u),
        room,
        found,
    )
    error = None if callbacks is None else callbacks.forget()
    if error is not None and not isinstance(error, Exception):
        raise error  # such as Ctrl+C
    lasting = _lasting(task, found[1][: found[3][:steps].sum() + 1])
    if equations and (isinstance(error, PlantError) or not _is_smooth(found, steps, lasting)):
        return None
    pids.remember(packed[2])
    return _record(env, refs, steps, found, lasting)


def compiled_plant(env: Any, controller: Any) -> LinearPlant | FunctionPlant | None:
    """Return the plant, without its loads, whose episodes run compiled; None of any other loop."""
    if not _are_known(controller) or type(env) is not PlantEnv or not _is_known(env, controller.T_s):
        return None
    plant: LinearPlant | FunctionPlant = _parts(env.plant)[0]
    return plant


def _are_known(pids: Any) -> bool:
    """Return whether a controller is made of PIDs of ours: a subclass may do anything in another way."""
    parts = pids, *getattr(pids, "pids", ())
    return all(vars(type(each)).keys() >= {"packed", "remember"} for each in parts)


def _is_known(env: PlantEnv, T_s: float) -> bool:
    """Return whether plant and task are of the kinds that are compiled."""
    plant, task = env.plant, env.task
    own = _parts(plant)[0]
    if type(own) not in (LinearPlant, FunctionPlant) or env.outputs_are_states:
        return False
    if len(own.states) > _LARGE or getattr(own, "entry_delay", None):
        return False
    longest = max(task.horizon, dead_times(plant).max(initial=0.0) + np.max(task.measurement_delay))
    own_rules = task.preview or task.settled is not never or task.unsafe(task.x0)
    return not own_rules and longest <= _LONGEST * T_s


def _parts(plant: Any) -> tuple[Any, ScaledPlant | None]:
    """Return a plant without loads and without what scales it, and what scales it, if anything does."""
    own: Any = plant.plant if type(plant) is Disturbed else plant
    return (own.plant, own) if type(own) is ScaledPlant else (own, None)


def _equations(plant: Any) -> tuple[tuple[Any, ...] | None, Callbacks | None]:
    """Return equations as compiled code takes them, and what calls back; none of a linear plant."""
    own, scaled = _parts(plant)
    if type(own) is LinearPlant:
        return None, None
    found, longest = own.callable_equations, inf if own.max_step is None else float(own.max_step)
    speed = 1.0 if scaled is None else float(scaled.speed)
    return (found.f, found.g, speed, longest, found.parameters, len(own.inputs)), found.callbacks


def _is_smooth(found: Any, steps: int, lasting: tuple[int, int | None]) -> bool:
    """Return whether an episode of equations ran to its end or an unsafe state, and all in it are numbers."""
    _, _, y, lengths, _, usable, y_end = found
    (kept, unsafe), ends = lasting, np.cumsum(lengths[:steps])
    if not steps or (unsafe is None and kept <= ends[-1]):
        return False
    steps = int(np.searchsorted(ends, kept - 1)) + 1
    numbers = np.isfinite(y[: kept - 1]).all() and np.isfinite(y_end[steps - 1]).all()
    return bool(numbers and usable[:steps].all())


def _lasting(task: Task, x: Matrix) -> tuple[int, int | None]:
    """Return how many states are kept, up to an unsafe or the last finite one, and the unsafe one's index."""
    whole = np.isfinite(x).all(axis=1)
    kept = len(x) if whole.all() else int(np.argmin(whole))
    with np.errstate(all="ignore"):  # a rule that takes all states at once sees those after the end, too
        unsafe = task.first_unsafe(x[1:kept]) if kept > 1 else None
    return (kept, None) if unsafe is None else (unsafe + 2, unsafe + 1)


def _over(signal: Signal | None, t: Float[np.ndarray, " N"]) -> Matrix:
    """Return the values of a signal at `t`, a row each."""
    if isinstance(signal, StepSignal):
        return signal.over(t)
    if callable(signal):
        rows = [np.array(signal(each), dtype=float) for each in t.tolist()]
        whole = len({row.shape for row in rows}) == rows[0].ndim == 1
        return np.array(rows) if whole else np.zeros((0, 0))
    return np.tile(np.asarray(signal), (len(t), 1))


def _draw(task: Task, T_s: float, seed: int, n_y: int) -> tuple[Float[np.ndarray, " N1"], Matrix]:
    """Return the ends of all periods, from 0 on, and the noise at their starts, drawn as `PlantEnv` draws."""
    random, last = np_random(seed)[0], task.horizon * (1 - 1e-12)
    size, bias = task.noise, 0.0 if task.bias is None else task.bias
    if not task.jitter:
        ends = np.arange(ceil(last / T_s) + 2) * T_s
        ends = ends[: int(np.searchsorted(ends, last)) + 1]
        noise = np.zeros((len(ends), n_y)) if size is None else random.standard_normal((len(ends), n_y))
    else:
        found, rows = [0.0], [] if size is None else [random.standard_normal(n_y)]
        while found[-1] < last:
            found.append((len(found) + task.jitter * int(random.integers(-1, 2))) * T_s)
            if size is not None:
                rows.append(random.standard_normal(n_y))
        ends = np.array(found)
        noise = np.array(rows) if rows else np.zeros((len(ends), n_y))
    return ends, bias + (noise if size is None else size * noise)


def _matrices(plant: Any, part: float) -> tuple[Any, ...] | None:
    """Return the generator of (x, a), or its step, room for its powers, and C and D; None of equations."""
    if type(own := _parts(plant)[0]) is not LinearPlant:
        return None
    from ._compiled_run import KEPT

    system, (n, m) = own.system, own.system.B.shape
    C, D = (np.array(part, dtype=float, order="C") for part in (system.C, system.D))
    generator = np.zeros((n + m, n + m))
    generator[:n, :n], generator[:n, n:] = system.A, system.B
    if system.dt:
        generator[n:, n:] = np.eye(m)
    kept = np.full(KEPT, -1), np.empty((KEPT, n, n + m)), np.zeros(1, dtype=np.int64)
    return (generator, part, float(system.dt)), kept, C, D


def _acting(plant: Any, d: Matrix) -> tuple[Matrix, tuple[Matrix, Any, Any]]:
    """Return what is added to the outputs in each period; a without inputs, and how inputs act."""
    own, scaled = _parts(plant)
    n_d, n_u = len(own.disturbances), len(own.inputs)
    shifts, offsets = np.zeros((len(d), n_u + n_d)), np.zeros((len(d), len(own.outputs)))
    shifts[:, n_u:] = d[:, :n_d]
    if type(own) is LinearPlant and own.rest:
        shifts[:, :n_u] -= own.rest[0]
        offsets += own.rest[1]
    if type(plant) is Disturbed:
        n_p = plant.on_y.shape[1]
        shifts[:, :n_u] += d[:, n_d + n_p :] @ plant.on_u.T
        offsets += d[:, n_d : n_d + n_p] @ plant.on_y.T
    how = (np.ones(n_u), np.zeros(n_u)) if scaled is None else (scaled.gains, scaled.offset)
    return offsets, (shifts, np.array(how[0]), np.array(how[1]))


def _delays(plant: Any, task: Task) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Return the dead times of inputs, outputs and measurements, and whether there are any."""
    dead, late = map(np.array, delays_of(plant))
    seen = late + np.broadcast_to(np.asarray(task.measurement_delay, dtype=float), len(late))
    return dead, late, seen, bool(dead.any() or late.any() or seen.any())


def _limits(plant: Any, task: Task) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lower and the upper limit of each input, and its largest move."""
    low, high = (np.array([getattr(c, name) for c in plant.inputs], dtype=float) for name in ("low", "high"))
    return low, high, np.full(len(low), inf) if task.max_move is None else np.array(task.max_move)


def _wear(worn: Worn | None, n_y: int, n_u: int) -> tuple[np.ndarray, ...]:
    """Return resolution, backlash, and room for the last command and whether there is one; -1: no wear."""
    if worn is None:
        return np.zeros(n_y), np.zeros(n_u), np.zeros(n_u), np.full(1, -1.0)
    return np.where(worn.rounded, worn.grain, 0.0), np.array(worn.play), np.zeros(n_u), np.zeros(1)


def _room(task: Task, ends: np.ndarray, how: tuple[Matrix, Any, Any], n_y: int) -> tuple[Any, Any]:
    """Return what the episode remembers, and where it writes what it finds."""
    shifts, gains, offset = how
    N, m, n, n_u = len(ends) - 1, shifts.shape[1], len(task.x0), len(task.u0)
    most, given, rows = N + ceil(ends[-1] / task.dense_step) + 2, 2 * N + 1, (2 * N + 1) * (1 + n_u)
    memory = np.full(given, -inf), np.empty((given, n_u)), np.ones(1, dtype=np.int64)
    starts, states, acting = np.full(rows, -inf), np.empty((rows, n)), np.empty((rows, m))
    spans = starts, states, acting, np.zeros(rows, dtype=np.int64), np.ones(1, dtype=np.int64)
    t, x, y = np.full(most, inf), np.zeros((most, n)), np.empty((most, n_y))
    t[0], x[0], states[0], memory[1][0], acting[0] = 0.0, task.x0, task.x0, task.u0, shifts[0]
    acting[0, :n_u] = gains * (acting[0, :n_u] + task.u0) + offset
    steps = np.zeros(N, dtype=np.int64), np.empty((N, n_u)), np.zeros(N, dtype=bool), np.empty((N, n_y))
    return (memory, spans), (t, x, y, *steps)


def _record(
    env: PlantEnv, refs: Matrix, steps: int, found: Any, lasting: tuple[int, int | None]
) -> tuple[Record, Any]:
    """Return the record of an episode until it ends, and the success of each step.

    Raises:
        PlantError: If f is not a number at the start.
    """
    t, x, y, lengths, u, usable, y_end = found
    task, starts = env.task, np.concatenate([[0], np.cumsum(lengths[:steps])])
    (kept, unsafe), rows = lasting, starts[-1] + 1
    stopped = kept < rows or unsafe is not None
    # The period of the last row, of which the start belongs to the one before, unless nothing else is left.
    steps = int(np.searchsorted(starts, kept - 1 + (unsafe is None and kept < rows), side="left"))
    if kept == steps == 1:
        check_rate(env.plant, task.x0, u[0], task.disturbance(0.0))
    y = y[:kept].copy()
    if kept - 1 == starts[steps]:  # the end of a period, after which no input is decided
        y[-1] = y_end[steps - 1]
    lengths = np.diff(np.minimum(starts[: steps + 1], kept - 1))
    record = Record(
        t=t[:kept],
        x=x[:kept],
        u=np.concatenate([np.repeat(u[:steps], lengths, axis=0), u[steps - 1 : steps]]),
        t_control=t[starts[:steps]],
        u_control=u[:steps],
        y_ref=refs[:steps],
        channels=env.channels,
        end=End.UNSAFE if stopped else End.TIME_UP,
        y=y,
    )
    return record, usable[:steps]


# --- A closed loop as a source, and the rollout of any controller in any environment.


class ClosedLoopEnv(Protocol):
    """The interface that `rollout` needs from an unwrapped environment, such as `PlantEnv`."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode; the option `T_s` is the controller's sampling time."""

    def measurement(self) -> Measurement:
        """Return what a controller knows at this sampling instant."""

    def apply(self, u: Float[np.ndarray, " n_u"]) -> Any:
        """Hold the input `u`, in the plant's units, for one sampling period."""

    @property
    def end(self) -> End | None:
        """Why the episode is over; None while it goes on."""

    def record(self) -> Record:
        """Return the episode so far, with its additional signals."""


def rollout(
    env: gym.Env[Any, Any] | ClosedLoopEnv,
    controller: Controller,
    theta: Float[np.ndarray, " n"],
    *,
    clock: Callable[[], float] = time.perf_counter,
    seed: int = 0,
    kpis: KPIs | None = None,
) -> Experiment:
    """Let `controller` drive `env` until the episode ends, and return the experiment.

    If the controller cannot solve a step, or its input is NaN, the last input is held;
    `Experiment.solved` marks such steps.

    Args:
        env: A `ClosedLoopEnv`, or an environment that is one when unwrapped.
        controller: Controller made from `theta`. Make a new one for each run: it may have a memory.
        theta: Controller parameters, physical, shape (n,), for the record.
        clock: Returns the time in seconds; used only for `Experiment.solve_time`.
        seed: Seed of the episode.
        kpis: Function that returns the key performance indicators of an experiment by name.

    Returns:
        The experiment, even if the run was stopped.

    Raises:
        ExperimentError: If `env` is not a `ClosedLoopEnv`, or `kpis` does not return a mapping.
        SettingsError: If the environment rejects the controller's sampling time, the controller
            has none, or its `move` does not return a `Move`.
        PlantError: If an input has the wrong shape.
    """
    loop: Any = getattr(env, "unwrapped", env)
    missing = [n for n in ("measurement", "apply", "end", "record") if not hasattr(loop, n)]
    if missing:
        raise ExperimentError(f"a rollout needs an environment with {missing}, got {loop!r}")
    # Through the wrappers, which may count or record episodes; the loop itself goes past them.
    env.reset(seed=seed, options={"T_s": _sampling_time(controller)})
    steps = _drive(loop, controller, clock)
    experiment = _experiment(loop.record(), theta, steps)
    return experiment if kpis is None else experiment.with_kpis(kpis)


def _drive(
    loop: ClosedLoopEnv, controller: Controller, clock: Callable[[], float]
) -> list[tuple[int, float, bool]]:
    """Drive `loop` to its end; return iterations, seconds and success of each step."""
    steps: list[tuple[int, float, bool]] = []
    while loop.end is None:
        measurement = loop.measurement()
        # Only the controller's own time: what the plant takes to simulate says nothing of its code.
        start = clock()
        move = controller.move(measurement)
        took = clock() - start
        if not isinstance(move, Move):
            raise SettingsError(
                f"move of controller {type(controller).__name__}{place_in_code(controller.move)} must "
                f"return a prefcal_env.Move, got {brief(move)}: write return Move(u), with u an "
                "array of shape (n_u,)"
            )
        # The plant refuses NaN as a caller's mistake; a controller that failed holds its input instead.
        usable = move.solved and not np.count_nonzero(np.isnan(move.u))
        loop.apply(move.u if usable else measurement.u)
        steps.append((move.iterations, took, usable))
    return steps


def _sampling_time(controller: Controller) -> object:
    T_s: object = getattr(controller, "T_s", None)
    if T_s is None or not callable(getattr(controller, "move", None)):
        raise SettingsError(
            "a controller needs T_s, its sampling time in the plant's unit of time, and "
            f"move(measurement); got {brief(controller)}"
        )
    return T_s


def _experiment(record: Record, theta: object, steps: list[tuple[int, float, bool]]) -> Experiment:
    # An episode has a step at least: no task ends at its start.
    iterations, solve_time, solved = zip(*steps, strict=True)
    return Experiment(
        theta=np.array(theta, dtype=float),
        iterations=np.array(iterations),
        solve_time=np.array(solve_time),
        solved=solved,
        **{field.name: getattr(record, field.name) for field in fields(record)},
    )


EnvSource = gym.Env[Any, Any] | str | Callable[[], gym.Env[Any, Any]]
ControllerFactory = Callable[[Float[np.ndarray, " n"]], Controller]


class ClosedLoop:
    """A `Run` that lets the controller of θ drive a plant environment until the episode ends.

    Plants that PIDs control run compiled (see `compiled_run`), if they can: then `env` runs no episode.

    Args:
        env: Plant environment, its id, or a function that makes it.
        controller: Function that makes a new controller from a physical θ, shape (n,).
        kpis: Function that returns the key performance indicators of an experiment by name. If they
            depend on plant and task, it has `around(env)`, which returns those of another environment,
            and `targets`, the index and the reference of each output that steps.

    Raises:
        SettingsError: If `env` or `controller` is none of these.
    """

    def __init__(self, env: EnvSource, controller: ControllerFactory, kpis: KPIs | None = None) -> None:
        made = gym.make(env) if isinstance(env, str) else env
        # An environment that can be called is still an environment.
        if callable(made) and not isinstance(made, gym.Env):
            made = made()
        if not isinstance(made, gym.Env):
            raise SettingsError(f"env must be an environment, an id or a factory, got {env!r}")
        if not callable(controller):
            raise SettingsError(f"controller must be a function of θ, got {controller!r}")
        self._env, self.controller, self.kpis = made, controller, kpis

    @property
    def env(self) -> gym.Env[Any, Any]:
        """Environment that the controllers drive, without its wrappers."""
        return self._env.unwrapped

    @property
    def channels(self) -> Channels | None:
        """Channels of the experiments; None if the environment does not define them."""
        # Somebody else's environment may have an attribute of this name that is something else.
        found = getattr(self.env, "channels", None)
        return found if isinstance(found, Channels) else None

    @property
    def signals(self) -> tuple[str, ...] | None:
        """Keys of the experiments' signals; None if the environment does not define them."""
        return getattr(self.env, "signals", None)

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run a physical θ, shape (n,)."""
        controller = self.controller(theta)
        found = compiled_run(self._env, controller, seed)
        if found is None:
            return rollout(self._env, controller, theta, seed=seed, kpis=self.kpis)
        record, solved = found
        experiment = _experiment(record, theta, [(0, 0.0, usable) for usable in solved.tolist()])
        return experiment if self.kpis is None else experiment.with_kpis(self.kpis)

    def varied(self) -> Varied:
        """Return what varies in the loop. Raises ScenarioError if its environment is no `PlantEnv`."""
        env = self.env
        if not isinstance(env, PlantEnv):
            raise ScenarioError(
                "only the loop of a PlantEnv can be varied, since it says its plant and task: "
                f"make its environment one, got {type(env).__name__}"
            )
        plant, task = env.plant, env.task
        # Only KPIs that can be measured around another step let the step vary.
        targets = getattr(self.kpis, "targets", ()) if hasattr(self.kpis, "around") else ()
        moves = moves_of(plant, task, plant.outputs, targets) if targets else Moves()
        said = () if targets else ((STEP, "the KPIs cannot be measured around another step"),)
        jitters = not getattr(plant, "sample_time", 0.0)
        loop = VariedLoop(plant, task, self._built, self.controller, jitters=jitters, moves=moves)
        return loop.varied(*said)

    def _built(self, plant: Disturbed, task: Task, grain: Y, play: U) -> Source:
        def worn(theta: Float[np.ndarray, " n"]) -> Controller:
            return Worn(self.controller(theta), grain, play, plant.inputs)

        env, around = PlantEnv(plant, task), getattr(self.kpis, "around", None)
        kpis = self.kpis if around is None else around(env)
        outputs = list(env.channels.y)
        # A picture of the run draws its own targets; other KPIs may call something else so.
        for i, target in getattr(kpis, "targets", ()) if around else ():
            outputs[i] = replace(outputs[i], target=target)
        env.channels = replace(env.channels, y=tuple(outputs))
        return Function(ClosedLoop(env, worn if grain.any() or play.any() else self.controller, kpis))
