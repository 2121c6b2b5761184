"""`prefcal/Overtake-v0`: the overtaking of section IV-B as an environment."""

from prefcal_env.envs.overtake.drive import Mishap as Mishap
from prefcal_env.envs.overtake.env import OvertakeEnv as OvertakeEnv
from prefcal_env.envs.overtake.options import Car as Car
from prefcal_env.envs.overtake.options import OvertakeOptions as OvertakeOptions
from prefcal_env.envs.overtake.options import dynamic_car as dynamic_car
from prefcal_env.envs.overtake.options import slipping_car as slipping_car
from prefcal_env.envs.overtake.traffic import Obstacle as Obstacle
