"""The overtaking as a closed loop, which `OvertakeEnv` shows on highway-env's road."""

from typing import Any

import numpy as np
from gymnasium.utils import seeding
from jaxtyping import Float

from prefcal_env.envs.checks import known_options, number, vector
from prefcal_env.envs.overtake.road.geometry import outside, overlap
from prefcal_env.envs.overtake.road.options import OvertakeOptions
from prefcal_env.envs.overtake.road.rules import T_S_RANGE
from prefcal_env.errors import PlantError, ProtocolError
from prefcal_env.experiments.control import Measurement
from prefcal_env.experiments.experiment import Channels, End
from prefcal_env.experiments.trajectory import Record
from prefcal_env.plants.bicycle import Bicycle

from .drive import ROAD_MARGIN, Mishap
from .episode import Driven, Episode

DEFAULT_T_S = 0.1


class Course:
    """A `ClosedLoopEnv` that drives episodes of the overtaking; `rollout` accepts it as it is.

    `OvertakeEnv` adds the spaces, rewards and pictures of an environment. This class does not load
    highway-env unless there are drivers.

    Args:
        options: Differences from the paper; None for none.
    """

    def __init__(self, options: OvertakeOptions | None = None) -> None:
        self.options = options or OvertakeOptions()
        self.plant = Bicycle()
        self.low, self.high = np.array([(c.low, c.high) for c in self.plant.inputs]).T
        self.channels = Channels(self.plant.states, self.plant.inputs, self.plant.outputs)
        self._episode: Episode | None = None
        self._rng: np.random.Generator | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Start an episode, with the options `T_s` [s] and `x0` as in `begin`.

        The seed determines the drivers; None continues the random numbers of the previous seed.
        """
        given = known_options(options, ("T_s", "x0"))
        if seed is not None or self._rng is None:
            self._rng, _ = seeding.np_random(seed)
        self.begin(given.get("T_s", DEFAULT_T_S), given.get("x0"), self._rng)

    def begin(self, T_s: Any, x0: Any, rng: np.random.Generator) -> None:
        """Start an episode: sampling time `T_s` [s], pose `x0` (None uses that of the options).

        Raises:
            SettingsError: If the sampling time is out of range.
            PlantError: If the pose has the wrong shape, is not finite, off the road, or in a
                collision.
        """
        T_s = number(T_s, T_S_RANGE, "T_s")
        pose = vector(self.options.x0 if x0 is None else x0, 3, "initial pose x0")
        episode, now = Episode(self.options, pose, T_s, rng), np.zeros(1)
        touching = any(overlap(pose[None], o.poses(now))[0] for o in episode.movers)
        if touching or outside(pose[None], self.options.road)[0] > ROAD_MARGIN:
            raise PlantError(f"the initial pose x0 is in a collision or off the road: {pose}")
        self._episode = episode

    @property
    def episode(self) -> Episode:
        """Current or last episode. Raises ProtocolError before the first."""
        if self._episode is None:
            raise ProtocolError("no episode yet: call reset() first")
        return self._episode

    @property
    def end(self) -> End | None:
        """Why the episode ended; None before the first episode and while one goes on."""
        return None if self._episode is None else self._episode.end

    @property
    def mishap(self) -> Mishap | None:
        """Reason why the episode ended early; None if it did not."""
        return None if self._episode is None else self._episode.mishap

    def apply(self, u: Float[np.ndarray, " 2"]) -> Driven:
        """Hold v [m/s] and δ_s [rad], shape (2,), for one sampling period; they saturate.

        Raises:
            PlantError: If the inputs have the wrong shape or are NaN.
            ProtocolError: If no episode is running.
        """
        episode = self.episode
        if episode.end is not None:
            raise ProtocolError("the episode is over: call reset() first")
        u = vector(u, 2, "input u", finite=False)
        return episode.apply(np.minimum(np.maximum(u, self.low), self.high))

    def measurement(self) -> Measurement:
        """Return what a controller knows: x is the pose, d is (x_o, y_o, v_o) of each.

        d has one row for each other vehicle. `y_ref` is (x_f, 0, 0), for lane keeping; references
        that depend on the phase are up to the controller. Raises ProtocolError before the first
        episode.
        """
        return self.episode.measurement()

    def record(self) -> Record:
        """Return the current or last episode. Raises ProtocolError if there is none.

        The record has n sub-steps of T_s/n in each period, of at most 0.02 s, and the end; a
        collision is recorded at its exact time. Its signals are those of `signals_of`.
        """
        return self.episode.record(self.channels)
