"""Plants as Gymnasium environments."""

from prefcal_env.envs.plant_env import PlantEnv as PlantEnv
from prefcal_env.envs.task import Step as Step
from prefcal_env.envs.task import Task as Task
from prefcal_env.envs.trajectory import Record as Record
