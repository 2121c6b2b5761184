"""Plants as Gymnasium environments."""

from prefcal_env.experiments.experiment import Record as Record

from .lti_loop import LTILoop as LTILoop
from .plant_env import PlantEnv as PlantEnv
from .task import Period as Period
from .task import Task as Task
