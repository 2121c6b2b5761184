"""Additional vehicles, drawn from the seed of an episode."""

from dataclasses import dataclass

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.plants.bicycle import KMH

from .rules import LANE_WIDTH, LENGTH
from .traffic import Driver, Obstacle

KINDS = ("constant", "braking", "cut-in", "oncoming", "idm")
"""Types of vehicles: constant speed, braking, cutting into our lane, oncoming, and a driver who
keeps their distance (highway-env's `IDMVehicle`)."""
_FIRST_ONCOMING = (100.0, 300.0)  # m, ahead of us
_DECELERATIONS, _MOMENTS = (0.5, 2.0), (2.0, 8.0)  # m/s²; s


@dataclass(frozen=True, slots=True)
class RandomTraffic:
    """A random queue of vehicles ahead of us, drawn from the seed of `reset`.

    Gaps, speeds, types, and when and how hard a vehicle brakes or cuts in (2 to 8 s, 0.5 to
    2 m/s²) are uniform. Oncoming vehicles start 100 to 300 m ahead, one behind the other.

    Args:
        count: Number of vehicles.
        types: Types among `KINDS`, from which each vehicle's type is drawn.
        gap: Smallest and largest gap between bodies in the queue, including the one to us [m].
        speed: Smallest and largest initial speed [m/s].

    Raises:
        SettingsError: If the count is below 0, a type is missing or unknown, or a range is not
            valid.
    """

    count: int
    types: tuple[str, ...] = ("constant", "braking", "idm")
    gap: tuple[float, float] = (15.0, 60.0)
    speed: tuple[float, float] = (30 * KMH, 45 * KMH)

    def __post_init__(self) -> None:
        if not isinstance(self.count, int) or isinstance(self.count, bool) or self.count < 0:
            raise SettingsError(f"random_traffic: count must be 0 or more, got {self.count!r}")
        if not self.types or not set(self.types) <= set(KINDS):
            raise SettingsError(f"random_traffic: types must be among {KINDS}, got {self.types!r}")
        for name in ("gap", "speed"):
            pair = getattr(self, name)
            numbers = all(isinstance(v, int | float) for v in pair) and len(pair) == 2
            if not numbers or not 0 < pair[0] <= pair[1] < np.inf:
                unit = "m" if name == "gap" else "m/s"
                raise SettingsError(
                    f"random_traffic: {name} must be (low, high) in {unit}, above 0, got {pair!r}"
                )

    def draw(
        self, rng: np.random.Generator, front: float, first_oncoming_lane: int
    ) -> tuple[Obstacle | Driver, ...]:
        """Return the vehicles of one episode.

        Args:
            rng: Random generator of the episode.
            front: End of the queue so far: the farthest front end in our direction [m].
            first_oncoming_lane: Lane of oncoming vehicles, counted from the right; 0 is ours.
        """
        drawn: list[Obstacle | Driver] = []
        toward = front + float(rng.uniform(*_FIRST_ONCOMING))
        for _ in range(self.count):
            kind = self.types[int(rng.integers(len(self.types)))]
            gap, speed = float(rng.uniform(*self.gap)), float(rng.uniform(*self.speed))
            moment = float(rng.uniform(*_MOMENTS))
            deceleration = float(rng.uniform(*_DECELERATIONS))
            if kind == "oncoming":
                y = LANE_WIDTH * first_oncoming_lane
                drawn.append(Obstacle(toward, y, speed, oncoming=True))
                toward += LENGTH + gap
                continue
            front += gap + LENGTH
            drawn.append(_vehicle(kind, front, speed, moment, deceleration))
        return tuple(drawn)


def _vehicle(
    kind: str, x: float, speed: float, moment: float, deceleration: float
) -> Obstacle | Driver:
    if kind == "idm":
        return Driver(x, 0.0, speed)
    if kind == "braking":
        return Obstacle(x, 0.0, speed, deceleration, brakes_at=moment)
    if kind == "cut-in":
        return Obstacle(x, LANE_WIDTH, speed, moves_to=0.0, moves_at=moment)
    return Obstacle(x, 0.0, speed)
