"""The viewer of the overtaking: highway-env's, without a window. Loads pygame."""

from typing import Any

import numpy as np
import pygame
from highway_env.envs.common.graphics import EnvViewer
from highway_env.road.graphics import RoadGraphics, WorldSurface
from jaxtyping import Float, UInt8

_VERGE = (72, 108, 70)
_VERGES = 6.6667  # m, total width shown beside the road
_FINER = 2  # factor by which pictures are drawn larger and then reduced, for smooth edges


class RoadViewer(EnvViewer):  # type: ignore[misc]
    """highway-env's viewer without a window: surfaces need no display and no video driver.

    highway-env's own constructor opens a window, and shows nothing with the dummy video driver.
    """

    def __init__(self, env: Any) -> None:
        self.env, self.config, self.offscreen = env, env.config, True
        right, left = env.options.road
        usual = round(self.config["scaling"] * (left - right + _VERGES))
        self._size = self.config["screen_width"], self.config["screen_height"] or usual
        width, height = (_FINER * pixels for pixels in self._size)
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
        right, left = (surface.pos2pix(0.0, -edge)[1] for edge in self.env.options.road)
        pygame.draw.rect(surface, _VERGE, (0, 0, width, left - _FINER))
        pygame.draw.rect(surface, _VERGE, (0, right + _FINER, width, height))
        RoadGraphics.display_traffic(self.env.road, surface, offscreen=True)

    def get_image(self) -> UInt8[np.ndarray, "h w 3"]:
        """Return the picture, RGB, shape (height, width, 3)."""
        small = pygame.transform.smoothscale(self.sim_surface, self._size)
        return np.ascontiguousarray(np.moveaxis(pygame.surfarray.array3d(small), 0, 1))

    def window_position(self) -> Float[np.ndarray, " 2"]:
        """Return the view position: beside the ego vehicle, on the middle of the road."""
        return np.array([self.env.vehicle.position[0], -sum(self.env.options.road) / 2])

    def close(self) -> None:
        """Do nothing: others in this process may be using pygame."""
