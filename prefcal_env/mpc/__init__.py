"""Model predictive control: eq. MPC on a linearized plant."""

from .controller import LinearMPC as LinearMPC
from .controller import MPCSettings as MPCSettings
from .controller import control_horizon as control_horizon
from .estimator import DisturbanceEstimator as DisturbanceEstimator
from .estimator import EstimatingMPC as EstimatingMPC
from .estimator import EstimatorSettings as EstimatorSettings
from .estimator import ExtendedKalmanFilter as ExtendedKalmanFilter
from .estimator import StateEstimate as StateEstimate
