"""Plants as Gymnasium environments."""

from prefcal_env.experiments.trajectory import Record as Record

from .plant_env import PlantEnv as PlantEnv
from .task import Step as Step
from .task import Task as Task
