"""prefcal: preference-based calibration of controllers; plants, experiments and environments.

Importing this package registers the environments `prefcal/CSTR-v0`, `prefcal/CSTRTuning-v0`,
`prefcal/Overtake-v0`, `prefcal/OvertakeTuning-v0` and `prefcal/Experiment-v0` with Gymnasium by
name; their dependencies are loaded only when an environment is made.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING, Any

from gymnasium import register as _register

from prefcal_env.controllers.do_mpc import DoMPC as DoMPC
from prefcal_env.envs.experiment_env import ClosedLoop as ClosedLoop
from prefcal_env.envs.preference_reward import PreferenceReward as PreferenceReward
from prefcal_env.envs.tuning_env import TuningEnv as TuningEnv
from prefcal_env.experiments.control import Controller as Controller
from prefcal_env.experiments.control import Measurement as Measurement
from prefcal_env.experiments.control import Move as Move
from prefcal_env.experiments.experiment import Channel as Channel
from prefcal_env.experiments.experiment import Channels as Channels
from prefcal_env.experiments.experiment import End as End
from prefcal_env.experiments.experiment import Experiment as Experiment
from prefcal_env.experiments.kpis import tracking_kpis as tracking_kpis
from prefcal_env.experiments.maneuvers import Maneuvers as Maneuvers
from prefcal_env.experiments.maneuvers import combined as combined
from prefcal_env.experiments.panels import Panel as Panel
from prefcal_env.experiments.recorded import recorded as recorded
from prefcal_env.experiments.rollout import rollout as rollout
from prefcal_env.knobs.constraints import Constraint as Constraint
from prefcal_env.knobs.constraints import LinearConstraint as LinearConstraint
from prefcal_env.knobs.knob import Knob as Knob
from prefcal_env.knobs.space import KnobSpace as KnobSpace
from prefcal_env.preferences.answer import Agent as Agent
from prefcal_env.preferences.answer import Answer as Answer
from prefcal_env.preferences.answer import Calibrator as Calibrator
from prefcal_env.preferences.answer import Mark as Mark
from prefcal_env.preferences.answer import Preference as Preference
from prefcal_env.preferences.answer import Query as Query
from prefcal_env.preferences.answer import Strength as Strength
from prefcal_env.preferences.answer import Suggestion as Suggestion
from prefcal_env.preferences.kpis import Outcome as Outcome
from prefcal_env.preferences.loop import Comparison as Comparison
from prefcal_env.preferences.loop import ask_and_tell as ask_and_tell
from prefcal_env.preferences.loop import calibrate as calibrate
from prefcal_env.preferences.run_facts import completed as completed

from .calibrators import BradleyTerry as BradleyTerry
from .calibrators import Criterion as Criterion
from .calibrators import HumanCalibrator as HumanCalibrator
from .calibrators import LatentCost as LatentCost
from .calibrators import Lexicographic as Lexicographic
from .calibrators import Thurstone as Thurstone
from .controllers.decentralized import Decentralized as Decentralized
from .controllers.pid import PID as PID
from .envs import LTILoop as LTILoop
from .envs import PlantEnv as PlantEnv
from .envs import Task as Task
from .errors import PrefcalError as PrefcalError
from .fmu import FMULoop as FMULoop
from .plants import FunctionPlant as FunctionPlant
from .plants import Plant as Plant
from .rig import Rig as Rig
from .tables import TableColumns as TableColumns
from .tables import from_frame as from_frame

if TYPE_CHECKING:
    from .mpc import LinearMPC as LinearMPC
    from .mpc import MPCSettings as MPCSettings

_LAZY = {"LinearMPC": "prefcal_env.mpc", "MPCSettings": "prefcal_env.mpc"}
"""Names that are imported when they are first used, since they load a compiler."""


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module(_LAZY[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY})


_register("prefcal/CSTR-v0", "prefcal_env.envs.cstr:cstr_env")
_register(
    "prefcal/CSTRTuning-v0",
    "prefcal_scenarios.cases.cstr:make_tuning_env",
    vector_entry_point="prefcal_scenarios.cases.cstr:make_tuning_vector",
)
_register("prefcal/Overtake-v0", "prefcal_env.envs.overtake.env:OvertakeEnv")
_register(
    "prefcal/OvertakeTuning-v0",
    "prefcal_scenarios.cases.overtake:make_tuning_env",
    vector_entry_point="prefcal_scenarios.cases.overtake:make_tuning_vector",
)
_register(
    "prefcal/Experiment-v0",
    "prefcal_env.envs.experiment_env:experiment_env",
    vector_entry_point="prefcal_env.envs.experiment_env:experiment_vector",
)
