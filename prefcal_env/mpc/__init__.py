"""Model predictive control: eq. MPC on a linearised plant."""

from prefcal_env.mpc.computation import Processor as Processor
from prefcal_env.mpc.computation import StepSize as StepSize
from prefcal_env.mpc.controller import LinearMPC as LinearMPC
from prefcal_env.mpc.estimating import DisturbanceEstimator as DisturbanceEstimator
from prefcal_env.mpc.estimating import EstimatingMPC as EstimatingMPC
from prefcal_env.mpc.estimating import EstimatorSettings as EstimatorSettings
from prefcal_env.mpc.estimator import Estimate as Estimate
from prefcal_env.mpc.estimator import ExtendedKalmanFilter as ExtendedKalmanFilter
from prefcal_env.mpc.processors import TimedStep as TimedStep
from prefcal_env.mpc.processors import fit_processor as fit_processor
from prefcal_env.mpc.processors import read_processor as read_processor
from prefcal_env.mpc.processors import write_processor as write_processor
from prefcal_env.mpc.settings import MPCSettings as MPCSettings
from prefcal_env.mpc.settings import control_horizon as control_horizon
