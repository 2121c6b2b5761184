"""Plants: what is controlled."""

from prefcal_env.plants.cstr import CSTR as CSTR
from prefcal_env.plants.cstr import CSTRParams as CSTRParams
from prefcal_env.plants.function_plant import FunctionPlant as FunctionPlant
from prefcal_env.plants.plant import Jacobians as Jacobians
from prefcal_env.plants.plant import Plant as Plant
