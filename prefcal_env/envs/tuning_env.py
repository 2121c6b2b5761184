"""Tuning as an environment, one experiment a step, and preferences as its reward."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import numbers
from prefcal_env.errors import ExperimentError, KnobError, ProtocolError, SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Panel, plots_of
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Answer, Calibrator, Preference

from .canvas import Canvas, DrawnCurve, check_render_mode

Array = np.ndarray[Any, Any]


class TuningEnv(gym.Env[Array, Array]):
    """`prefcal/Experiment-v0`: you choose θ and see the experiment. One step is one episode.

    - Action, float, shape (n,): θ in the unit cube scaled to [-1, 1]; action = 2 z - 1 with
      z = `space.encode(theta)`. Several actions give the same θ if a knob is an integer or frozen.
    - Observation, float32, shape (n,): the θ that was run, scaled like the action and snapped to
      the knobs; zeros before the step. Each experiment starts anew, so there is no other state.
    - Reward: minus `score`, or 0 without a score. If you have no score, wrap this environment in
      `PreferenceReward`.
    - Every step terminates the episode (the end is not a time limit).
    - Info: `experiment`, the `Experiment`, and `theta`, physical, shape (n,).

    All experiments use the seed of the last seeded `reset` (0 at first), so that every θ is
    compared under the same noise.

    Args:
        space: Space of the knobs.
        run: Function that runs one experiment of a physical θ, shape (n,), and a `seed`, such as a
            `ClosedLoop` of your own plant and controller.
        score: Function that rates an experiment; lower is better.
        panels: Curves to draw; None draws all states, inputs and outputs.
        title: Title of the pictures.
        render_mode: None, or "rgb_array" for a picture of the last experiment.

    Raises:
        SettingsError: If the render mode is unknown, `space` is not a `KnobSpace`, or `run` is not
            callable.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012

    def __init__(
        self,
        space: KnobSpace,
        run: Callable[..., Experiment],
        *,
        score: Callable[[Experiment], float] | None = None,
        panels: Sequence[Panel] | None = None,
        title: str = "experiment",
        render_mode: str | None = None,
    ) -> None:
        if not isinstance(space, KnobSpace) or not callable(run):
            raise SettingsError(f"needs a KnobSpace and a function that runs θ, got {space!r} and {run!r}")
        check_render_mode(render_mode, self.metadata)
        self.space, self.render_mode = space, render_mode
        self._run, self._score, self._panels = run, score, panels
        box = (-1.0, 1.0, (len(space),), np.float32)
        self.action_space, self.observation_space = gym.spaces.Box(*box), gym.spaces.Box(*box)
        self._canvas = Canvas(title, panels=3 if panels is None else len(panels))
        self._experiment: Experiment | None = None
        self._seed, self._open = 0, False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Prepare the next experiment. There are no options: the action is θ."""
        super().reset(seed=seed)
        if options:
            raise SettingsError(f"a tuning environment has no reset options, got {options}")
        # Without a seed the noise stays, so that the next θ is compared with the last one under the same.
        self._seed = self._seed if seed is None else seed
        self._open = True
        return np.zeros(len(self.space), np.float32), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Run the experiment of `action`, shape (n,), θ in the unit cube scaled to [-1, 1].

        Raises:
            KnobError: If the action has the wrong shape, is NaN, or is outside [-1, 1].
            ExperimentError: If the run returns no experiment or its score is not finite.
            ProtocolError: If the episode, which has one step, is over.
        """
        if not self._open:
            raise ProtocolError("an episode is one experiment: call reset() before each")
        theta = self.theta(action)
        self._experiment = experiment = self.run(theta)
        # After the run: if it raises, the episode is still open and can be tried again.
        self._open = False
        score = 0.0 if self._score is None else float(self._score(experiment))
        if not np.isfinite(score):
            raise ExperimentError(f"a score must be finite, got {score} at θ = {theta}")
        # Of what ran, not of the action: several actions are rounded to the same θ.
        observation = (2 * self.space.encode(theta) - 1).astype(np.float32)
        info = {"experiment": experiment, "theta": theta}
        reward = 0.0 - score  # not -score: 0 without a score, rather than -0
        return observation, reward, True, False, info

    def run(self, theta: Float[np.ndarray, " n"]) -> Experiment:
        """Return the experiment of a physical θ, shape (n,), without a step of the environment.

        `calibrate` and the `simulate` of an agent take it where they need a run.

        Raises:
            KnobError: If θ is not valid.
            ExperimentError: If the run returns no experiment.
        """
        experiment = self._run(self.space.check(theta), seed=self._seed)
        if not isinstance(experiment, Experiment):
            raise ExperimentError(f"a run must return an Experiment, got {experiment!r}")
        return experiment

    def theta(self, action: Array) -> Float[np.ndarray, " n"]:
        """Return the physical θ of an action, both shape (n,). Raises KnobError as `step`."""
        a = numbers(action, "an action", KnobError)
        if a.shape != (len(self.space),) or not np.all(np.abs(a) <= 1):
            raise KnobError(
                f"an action must be {len(self.space)} numbers in [-1, 1], one for each of "
                f"{self.space.names}, got {a}"
            )
        # A frozen knob keeps its exact value, which decoding could round.
        frozen = [low for low, _ in self.space.within]
        return np.where(self.space.frozen, frozen, self.space.decode((a + 1) / 2))

    def render(self) -> Array | None:
        """Return an image of the last experiment, (height, width, 3) uint8, or None."""
        if self.render_mode is None:
            return None
        if self._experiment is None:
            return self._canvas.frame([])
        named = self.space.named(self._experiment.theta)
        note = ", ".join(f"{name} = {value:.4g}" for name, value in named.items())
        e, panels = self._experiment, self._panels
        self._canvas.time_label = f"time [{e.channels.time_unit}]"
        found = [p.plot(e) if len(e.t) else p.absent() for p in panels or ()]
        plots = plots_of(e.channels) if panels is None else found
        return self._canvas.frame([DrawnCurve(p.channel, e.t, p.values(e), p.held) for p in plots], note)

    def close(self) -> None:
        """Release the figure."""
        self._canvas.close()


def sampled_at(space: KnobSpace, T_s: float | None) -> KnobSpace:
    """Return `space` with its knob "T_s" frozen at `T_s`, unless that is None.

    Raises:
        KnobError: If the sampling time is outside the knob's range.
    """
    return space if T_s is None else space.narrowed({"T_s": (T_s, T_s)})


def same_step_vector(env_id: str, num_envs: int = 1, **kwargs: Any) -> gym.vector.SyncVectorEnv:
    """Return `num_envs` one-step environments that reset in the same step that ends an episode.

    Gymnasium's default resets in the following step, which would waste every second step of such
    environments. Experiments are in `infos["final_info"]["experiment"]`.
    """
    return gym.vector.SyncVectorEnv(
        [lambda: gym.make(env_id, **kwargs) for _ in range(num_envs)],
        autoreset_mode=gym.vector.AutoresetMode.SAME_STEP,
    )


experiment_vector = partial(same_step_vector, "prefcal/Experiment-v0")
"""Make several `prefcal/Experiment-v0`, without wasted steps (see `same_step_vector`)."""


class PreferenceReward(gym.Wrapper[Array, Array, Array, Array], gym.utils.RecordConstructorArgs):
    """A wrapper that rewards an experiment by comparing it with the best one so far.

    The reward is +1 if the calibrator prefers the new experiment (which becomes the incumbent), -1
    if they prefer the incumbent, and 0 for a tie, an abstention and the very first experiment.

    The observation is the incumbent's θ, scaled like the action (zeros without an incumbent),
    because the reward depends on it. `reset(seed=...)` forgets the incumbent, `reset()` keeps it.
    Info also has `preference` (-1, 0 or 1; absent for an abstention) and `incumbent`, the best
    `Experiment` so far.

    Args:
        env: Tuning environment whose info has an `experiment`.
        calibrator: Calibrator that compares two experiments.

    Raises:
        SettingsError: If `calibrator` has no `prefer`; in `step`, if the info has no experiment.
        PreferenceError: If the calibrator's answer in `step` is not valid.
    """

    def __init__(self, env: gym.Env[Array, Array], calibrator: Calibrator[Experiment]) -> None:
        if not isinstance(calibrator, Calibrator):
            raise SettingsError(f"calibrator must have a method prefer, got {calibrator!r}")
        # Gymnasium makes the spec of a wrapped environment from these arguments.
        gym.utils.RecordConstructorArgs.__init__(self, calibrator=calibrator)
        super().__init__(env)
        self._calibrator = calibrator
        self._incumbent: Experiment | None = None
        self._where: Array = np.zeros(env.observation_space.shape or (), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Prepare the next experiment; with a seed, forget the incumbent."""
        observation, info = self.env.reset(seed=seed, options=options)
        # A new seed is a new study: a best one of other noise would win or lose by luck.
        if seed is not None:
            self._incumbent, self._where = None, np.zeros_like(observation)
        return self._where.copy(), info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Run the experiment of `action` and compare it with the incumbent."""
        observation, _, terminated, truncated, info = self.env.step(action)
        experiment = info.get("experiment")
        if not isinstance(experiment, Experiment):
            raise SettingsError("PreferenceReward needs an environment with info['experiment']")
        answer = Answer(None)
        if self._incumbent is not None:
            answer = Answer.of(self._calibrator.prefer(experiment, self._incumbent))
        # A tie keeps the incumbent, as in every study.
        if self._incumbent is None or answer.preference is Preference.CHALLENGER:
            self._incumbent, self._where = experiment, observation.copy()
        info = info | {"incumbent": self._incumbent}
        if answer.preference is not None:
            info["preference"] = int(answer.preference)
        # Preferences are -1 where the challenger is better (eq. pref_fun), rewards the other way round.
        reward = 0.0 if answer.preference is None else -float(answer.preference)
        return self._where.copy(), reward, terminated, truncated, info
