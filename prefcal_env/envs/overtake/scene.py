"""The overtaking on highway-env's road, for pictures. Loads highway-env and pygame.

We drive: poses come from our plant and its dense trajectory, and highway-env's own physics,
collisions and lane look-up stay out of it. Its y points down and its vehicles' position is their
centre, ours is the front end with y to the left; here alone one becomes the other.
"""

from typing import Any

import numpy as np
import pygame
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.graphics import EnvViewer
from highway_env.road.graphics import RoadGraphics, WorldSurface
from highway_env.road.lane import LineType, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.kinematics import Vehicle
from jaxtyping import Float, UInt8

from prefcal_env.envs.overtake.geometry import centres
from prefcal_env.errors import ProtocolError
from prefcal_env.overtaking import LANE_WIDTH, LENGTH, ROAD, WIDTH

SIZE = (960, 176)
"""Width and height of a picture [pixels]."""
OWN, OTHER, CRASHED = (64, 156, 255), (255, 176, 46), (230, 57, 70)
"""Colours of the own vehicle, of the others, and of the own one in a collision, RGB."""
_VERGE, _SCALE, _OWN_PLACE = (72, 108, 70), 12.0, 0.3
_FINER = 2  # drawn so many times larger, then reduced: smooth edges
_ROAD_START, _ROAD_END = -1e3, 1e5  # m; far from wherever one may drive


class Scene(AbstractEnv):  # type: ignore[misc]
    """Two lanes, the own vehicle and `n_others` more; `show` places them, `render` draws them.

    It does not step: `OvertakeEnv` is the environment, this is what it looks like.
    """

    def __init__(self, n_others: int) -> None:
        self._n_others = n_others
        size = {"screen_width": SIZE[0], "screen_height": SIZE[1], "scaling": _SCALE}
        super().__init__(
            size
            | {"action": {"type": "ContinuousAction"}, "centering_position": [_OWN_PLACE, 0.5]},
            render_mode="rgb_array",
        )
        self.viewer = _Viewer(self)

    def show(
        self,
        pose: Float[np.ndarray, " 3"],
        others: Float[np.ndarray, "n 3"],
        u: Float[np.ndarray, " 2"],
        *,
        collided: bool = False,
    ) -> None:
        """Place everybody.

        Args:
            pose: The own front end (x_f, y_f [m], θ [rad]), shape (3,).
            others: (x_o, y_o [m], v_o [m/s]) of each other vehicle, shape (n_others, 3).
            u: The own v [m/s] and δ_s [rad], shape (2,).
            collided: Whether to colour the own vehicle as crashed.
        """
        own, *vehicles = self.road.vehicles
        _place(own, pose, float(u[0]), float(u[1]))
        own.color = CRASHED if collided else OWN
        for vehicle, (x, y, v) in zip(vehicles, others.tolist(), strict=True):
            _place(vehicle, np.array([x, y, 0.0]), v, 0.0)

    def step(self, action: Any) -> Any:
        """Refuse: nothing here moves by itself."""
        raise ProtocolError("a scene shows what OvertakeEnv drives: step that one")

    def _reset(self) -> None:
        network = RoadNetwork()
        solid, dashed, none = LineType.CONTINUOUS_LINE, LineType.STRIPED, LineType.NONE
        for y, lines in ((0.0, (dashed, solid)), (LANE_WIDTH, (solid, none))):
            ends = (np.array([x, -y]) for x in (_ROAD_START, _ROAD_END))
            network.add_lane("start", "end", StraightLane(*ends, LANE_WIDTH, lines))
        self.road = Road(network, np_random=self.np_random, record_history=False)
        self.road.vehicles = [_vehicle(self.road, OWN)]
        self.road.vehicles += [_vehicle(self.road, OTHER) for _ in range(self._n_others)]
        self.vehicle = self.road.vehicles[0]


class _Viewer(EnvViewer):  # type: ignore[misc]
    """highway-env's viewer without a window: surfaces need no display, and no video driver.

    Its own constructor opens one, and shows nothing where the driver is the dummy one.
    """

    def __init__(self, scene: Scene) -> None:
        self.env, self.config, self.offscreen = scene, scene.config, True
        width, height = (_FINER * pixels for pixels in SIZE)
        surface = WorldSurface((width, height), 0, pygame.Surface((width, height)))
        surface.scaling = _FINER * self.config["scaling"]
        surface.centering_position = self.config["centering_position"]
        self.sim_surface = surface

    def display(self) -> None:
        """Draw road, verges and vehicles."""
        surface = self.sim_surface
        surface.move_display_window_to(self.window_position())
        RoadGraphics.display(self.env.road, surface)
        width, height = surface.get_size()
        right, left = (surface.pos2pix(0.0, -edge)[1] for edge in ROAD)
        pygame.draw.rect(surface, _VERGE, (0, 0, width, left - _FINER))
        pygame.draw.rect(surface, _VERGE, (0, right + _FINER, width, height))
        RoadGraphics.display_traffic(self.env.road, surface, offscreen=True)

    def get_image(self) -> UInt8[np.ndarray, "h w 3"]:
        """The picture, RGB, shape (height, width, 3)."""
        small = pygame.transform.smoothscale(self.sim_surface, SIZE)
        return np.ascontiguousarray(np.moveaxis(pygame.surfarray.array3d(small), 0, 1))

    def window_position(self) -> Float[np.ndarray, " 2"]:
        """Beside the own vehicle on the middle of the road, which stays where it is."""
        return np.array([self.env.vehicle.position[0], -sum(ROAD) / 2])

    def close(self) -> None:
        """Leave pygame as it is: others in this process may be using it."""


def _vehicle(road: Road, color: tuple[int, int, int]) -> Vehicle:
    vehicle = Vehicle(road, [0.0, 0.0])
    vehicle.LENGTH, vehicle.WIDTH, vehicle.color = LENGTH, WIDTH, color
    return vehicle


def _place(vehicle: Vehicle, pose: Float[np.ndarray, " 3"], speed: float, steering: float) -> None:
    x, y = centres(pose[None])[0]
    vehicle.position = np.array([x, -y])
    vehicle.heading, vehicle.speed = -float(pose[2]), speed
    vehicle.action = {"steering": -steering, "acceleration": 0.0}
