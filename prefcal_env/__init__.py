"""prefcal: preference-based calibration of controllers; plants, experiments and environments.

Importing this registers the environments `prefcal/CSTR-v0`, `prefcal/CSTRTuning-v0`,
`prefcal/Overtake-v0`, `prefcal/OvertakeTuning-v0` and `prefcal/Experiment-v0` with Gymnasium, by
name: what they need is loaded when they are made.
"""

from gymnasium import register as _register

from prefcal_env.calibrators import BradleyTerry as BradleyTerry
from prefcal_env.calibrators import Criterion as Criterion
from prefcal_env.calibrators import HumanCalibrator as HumanCalibrator
from prefcal_env.calibrators import LatentCost as LatentCost
from prefcal_env.calibrators import Lexicographic as Lexicographic
from prefcal_env.calibrators import Thurstone as Thurstone
from prefcal_env.completing import completed as completed
from prefcal_env.constraints import Constraint as Constraint
from prefcal_env.constraints import LinearConstraint as LinearConstraint
from prefcal_env.control import Controller as Controller
from prefcal_env.control import Measurement as Measurement
from prefcal_env.control import Move as Move
from prefcal_env.envs import PlantEnv as PlantEnv
from prefcal_env.envs import Task as Task
from prefcal_env.errors import PrefcalError as PrefcalError
from prefcal_env.experiment import Channel as Channel
from prefcal_env.experiment import Channels as Channels
from prefcal_env.experiment import End as End
from prefcal_env.experiment import Experiment as Experiment
from prefcal_env.knobs import Knob as Knob
from prefcal_env.knobs import KnobSpace as KnobSpace
from prefcal_env.outcome import Outcome as Outcome
from prefcal_env.panels import Panel as Panel
from prefcal_env.preference import Agent as Agent
from prefcal_env.preference import Answer as Answer
from prefcal_env.preference import Calibrator as Calibrator
from prefcal_env.preference import Mark as Mark
from prefcal_env.preference import Preference as Preference
from prefcal_env.preference import Query as Query
from prefcal_env.preference import Strength as Strength
from prefcal_env.preference import Suggestion as Suggestion
from prefcal_env.preference_reward import PreferenceReward as PreferenceReward
from prefcal_env.rig import Rig as Rig
from prefcal_env.rollout import rollout as rollout
from prefcal_env.study import Comparison as Comparison
from prefcal_env.study import calibrate as calibrate
from prefcal_env.tracking import tracking_kpis as tracking_kpis
from prefcal_env.tuning import TuningEnv as TuningEnv

_register("prefcal/CSTR-v0", "prefcal_env.envs.cstr:cstr_env")
_register(
    "prefcal/CSTRTuning-v0",
    "prefcal_scenarios.cstr:make_tuning_env",
    vector_entry_point="prefcal_scenarios.cstr:make_tuning_vector",
)
_register("prefcal/Overtake-v0", "prefcal_env.envs.overtake.env:OvertakeEnv")
_register(
    "prefcal/OvertakeTuning-v0",
    "prefcal_scenarios.overtake:make_tuning_env",
    vector_entry_point="prefcal_scenarios.overtake:make_tuning_vector",
)
_register(
    "prefcal/Experiment-v0",
    "prefcal_env.own_experiment:experiment_env",
    vector_entry_point="prefcal_env.own_experiment:experiment_vector",
)
