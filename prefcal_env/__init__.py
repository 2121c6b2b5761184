"""prefcal: preference-based calibration of controllers; plants, experiments and environments.

Importing this package registers the environments `prefcal/CSTR-v0`, `prefcal/Overtake-v0` and
`prefcal/Experiment-v0` with Gymnasium by name; their dependencies are loaded only when an
environment is made. The names below are imported on first use: a script pays for what it uses.
"""

from importlib import import_module as _import_module
from importlib.util import find_spec as _find_spec
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from gymnasium import register as _register

if _TYPE_CHECKING:
    from .calibrators import BradleyTerry as BradleyTerry
    from .calibrators import Criterion as Criterion
    from .calibrators import HumanCalibrator as HumanCalibrator
    from .calibrators import LatentCost as LatentCost
    from .calibrators import Lexicographic as Lexicographic
    from .calibrators import Thurstone as Thurstone
    from .controllers.decentralized import Decentralized as Decentralized
    from .controllers.do_mpc import DoMPC as DoMPC
    from .controllers.lqg import LQG as LQG
    from .controllers.lqr import LQR as LQR
    from .controllers.pid import PID as PID
    from .envs import LTILoop as LTILoop
    from .envs import PlantEnv as PlantEnv
    from .envs import Task as Task
    from .envs.closed_loop import ClosedLoop as ClosedLoop
    from .envs.preference_reward import PreferenceReward as PreferenceReward
    from .envs.tuning_env import TuningEnv as TuningEnv
    from .errors import PrefcalError as PrefcalError
    from .experiments.control import Controller as Controller
    from .experiments.control import Measurement as Measurement
    from .experiments.control import Move as Move
    from .experiments.experiment import Channel as Channel
    from .experiments.experiment import Channels as Channels
    from .experiments.experiment import End as End
    from .experiments.experiment import Experiment as Experiment
    from .experiments.maneuvers import combined as combined
    from .experiments.panels import Panel as Panel
    from .experiments.rollout import rollout as rollout
    from .experiments.tracking import tracking_kpis as tracking_kpis
    from .fmu import FMULoop as FMULoop
    from .knobs.constraints import Constraint as Constraint
    from .knobs.constraints import LinearConstraint as LinearConstraint
    from .knobs.knob import Knob as Knob
    from .knobs.space import KnobSpace as KnobSpace
    from .mpc import LinearMPC as LinearMPC
    from .mpc import MPCSettings as MPCSettings
    from .plants import FunctionPlant as FunctionPlant
    from .plants import Plant as Plant
    from .preferences.answer import Agent as Agent
    from .preferences.answer import Answer as Answer
    from .preferences.answer import Calibrator as Calibrator
    from .preferences.answer import Mark as Mark
    from .preferences.answer import Preference as Preference
    from .preferences.answer import Query as Query
    from .preferences.answer import Suggestion as Suggestion
    from .preferences.kpis import Outcome as Outcome
    from .preferences.loop import Comparison as Comparison
    from .preferences.loop import ask_and_tell as ask_and_tell
    from .preferences.loop import calibrate as calibrate
    from .preferences.loop import completed as completed
    from .sources import Maneuvers as Maneuvers
    from .sources import Rig as Rig
    from .sources import Run as Run
    from .sources import Source as Source
    from .tables import TableColumns as TableColumns
    from .tables import from_frame as from_frame
    from .tables.recorded import recorded as recorded

_HOMES = {
    name: home
    for home, names in {
        "calibrators": "BradleyTerry Criterion HumanCalibrator LatentCost Lexicographic Thurstone",
        "controllers.decentralized": "Decentralized",
        "controllers.do_mpc": "DoMPC",
        "controllers.lqg": "LQG",
        "controllers.lqr": "LQR",
        "controllers.pid": "PID",
        "envs": "LTILoop PlantEnv Task",
        "envs.closed_loop": "ClosedLoop",
        "envs.preference_reward": "PreferenceReward",
        "envs.tuning_env": "TuningEnv",
        "errors": "PrefcalError",
        "experiments.control": "Controller Measurement Move",
        "experiments.experiment": "Channel Channels End Experiment",
        "experiments.tracking": "tracking_kpis",
        "experiments.maneuvers": "combined",
        "experiments.panels": "Panel",
        "tables.recorded": "recorded",
        "experiments.rollout": "rollout",
        "fmu": "FMULoop",
        "knobs.constraints": "Constraint LinearConstraint",
        "knobs.knob": "Knob",
        "knobs.space": "KnobSpace",
        "mpc": "LinearMPC MPCSettings",
        "plants": "FunctionPlant Plant",
        "preferences.answer": "Agent Answer Calibrator Mark Preference Query Suggestion",
        "preferences.kpis": "Outcome",
        "preferences.loop": "Comparison ask_and_tell calibrate completed",
        "sources": "Maneuvers Rig Run Source",
        "tables": "TableColumns from_frame",
    }.items()
    for name in names.split()
}
"""Module of each public name."""

__all__ = list(_HOMES)


def __getattr__(name: str) -> _Any:
    if name in _HOMES:
        found = getattr(_import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = found
        return found
    if not name.startswith("_") and _find_spec(f"{__name__}.{name}") is not None:
        return _import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})


_register("prefcal/CSTR-v0", "prefcal_env.envs.cstr:cstr_env")
_register("prefcal/Overtake-v0", "prefcal_env.envs.overtake.env:OvertakeEnv")
_register(
    "prefcal/Experiment-v0",
    "prefcal_env.envs.tuning_env:TuningEnv",
    vector_entry_point="prefcal_env.envs.tuning_env:experiment_vector",
)
