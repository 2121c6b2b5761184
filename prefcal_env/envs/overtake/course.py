"""The overtaking as a closed loop: what `OvertakeEnv` shows on highway-env's road."""

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

from .drive import ROAD_MARGIN, Mishap
from .episode import Driven, Episode

DEFAULT_T_S = 0.1


class Course:
    """Drives episodes of the overtaking; a `ClosedLoopEnv`, so `rollout` takes it as it is.

    `OvertakeEnv` is this with the spaces, the rewards and the pictures of an environment. By
    itself it loads no highway-env, as long as no `Driver` is among the others.

    Args:
        options: What differs from the paper; None: nothing.
    """

    def __init__(self, options: OvertakeOptions | None = None) -> None:
        self.options = options or OvertakeOptions()
        self.plant = self.options.car.plant
        self.low, self.high = np.array([(c.low, c.high) for c in self.plant.inputs]).T
        self.channels = Channels(self.plant.states, self.plant.inputs, self.plant.outputs)
        self._episode: Episode | None = None
        self._rng: np.random.Generator | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Start an episode, with the options `T_s` [s] and `x0`, as `begin`.

        The seed decides about measurement noise and random traffic; None: as the seed before goes
        on.
        """
        given = known_options(options, ("T_s", "x0"))
        if seed is not None or self._rng is None:
            self._rng, _ = seeding.np_random(seed)
        self.begin(given.get("T_s", DEFAULT_T_S), given.get("x0"), self._rng)

    def begin(self, T_s: Any, x0: Any, rng: np.random.Generator) -> None:
        """Start an episode: sampling time `T_s` [s], pose `x0` (None: that of the options).

        Raises:
            SettingsError: a sampling time out of range.
            PlantError: a pose of the wrong shape, not finite, off the road or in a collision.
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
        """The one under way, or the last one. Raises ProtocolError before the first."""
        if self._episode is None:
            raise ProtocolError("no episode yet: call reset() first")
        return self._episode

    @property
    def end(self) -> End | None:
        """Why the episode is over; None while it goes on, and before the first one."""
        return None if self._episode is None else self._episode.end

    @property
    def mishap(self) -> Mishap | None:
        """What ended the episode before its time, if anything did."""
        return None if self._episode is None else self._episode.mishap

    def apply(self, u: Float[np.ndarray, " 2"]) -> Driven:
        """Hold v [m/s] and δ_s [rad], shape (2,), for one sampling period; they saturate.

        Raises:
            PlantError: inputs of the wrong shape or NaN.
            ProtocolError: no episode is under way.
        """
        episode = self.episode
        if episode.end is not None:
            raise ProtocolError("the episode is over: call reset() first")
        u = vector(u, 2, "input u", finite=False)
        return episode.apply(np.minimum(np.maximum(u, self.low), self.high))

    def measurement(self) -> Measurement:
        """What a controller knows now: x the measured pose, d (x_o, y_o, v_o) of each other one.

        `y_ref` is (x_f, 0, 0), that of lane keeping; references that follow from the phase are
        the controller's own. Raises ProtocolError before the first episode.
        """
        return self.episode.measurement()

    def record(self) -> Record:
        """The episode so far, or the last one once it has ended. Raises ProtocolError if none.

        Recorded are n sub-steps of T_s/n a period, of 0.02 s at most, and the end; a collision at
        its very time. Its signals are those of `signals_of`.
        """
        return self.episode.record(self.channels)
