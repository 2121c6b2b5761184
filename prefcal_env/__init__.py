"""prefcal: preference-based calibration of controllers; plants, experiments and environments.

Importing this package registers the environments `prefcal/CSTR-v0`, `prefcal/Overtake-v0` and
`prefcal/Experiment-v0` with Gymnasium by name; their dependencies are loaded only when an
environment is made. The names below are imported on first use: a script pays for what it uses.
"""

from typing import TYPE_CHECKING

from gymnasium import register as _register

from .on_first_use import public_names

if TYPE_CHECKING:
    from .calibrators import HumanCalibrator as HumanCalibrator
    from .calibrators import LatentCost as LatentCost
    from .controllers.lqr import LQG as LQG
    from .controllers.lqr import LQR as LQR
    from .controllers.pid import PID as PID
    from .envs import LTILoop as LTILoop
    from .envs import PlantEnv as PlantEnv
    from .envs import Task as Task
    from .envs.closed_loop import ClosedLoop as ClosedLoop
    from .envs.closed_loop import rollout as rollout
    from .errors import PrefcalError as PrefcalError
    from .experiments.experiment import Channel as Channel
    from .experiments.experiment import Channels as Channels
    from .experiments.experiment import End as End
    from .experiments.experiment import Experiment as Experiment
    from .experiments.experiment import Measurement as Measurement
    from .experiments.experiment import Move as Move
    from .experiments.kpis import tracking_kpis as tracking_kpis
    from .experiments.panels import Panel as Panel
    from .knobs import Constraint as Constraint
    from .knobs import Knob as Knob
    from .knobs import KnobSpace as KnobSpace
    from .knobs import LinearConstraint as LinearConstraint
    from .mpc import LinearMPC as LinearMPC
    from .mpc import MPCSettings as MPCSettings
    from .plants import FunctionPlant as FunctionPlant
    from .plants import Plant as Plant
    from .preferences.answer import Answer as Answer
    from .preferences.answer import Calibrator as Calibrator
    from .preferences.answer import Mark as Mark
    from .preferences.answer import Preference as Preference
    from .preferences.answer import Query as Query
    from .preferences.answer import calibrate as calibrate
    from .sources import Maneuvers as Maneuvers
    from .sources import Rig as Rig
    from .sources import Run as Run
    from .sources import Source as Source
    from .tables import TableColumns as TableColumns
    from .tables import from_frame as from_frame
    from .tables.recorded import recorded as recorded
    from .worlds.do_mpc import DoMPC as DoMPC
    from .worlds.fmu import FMULoop as FMULoop

__getattr__, __dir__, __all__ = public_names(__name__)

_register("prefcal/CSTR-v0", "prefcal_env.envs.cstr:cstr_env")
_register("prefcal/Overtake-v0", "prefcal_env.envs.overtake.env:OvertakeEnv")
_register(
    "prefcal/Experiment-v0",
    "prefcal_env.envs.tuning_env:TuningEnv",
    vector_entry_point="prefcal_env.envs.tuning_env:experiment_vector",
)
