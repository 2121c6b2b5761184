"""Model predictive control: eq. MPC on a linearized plant."""

from .controller import LinearMPC as LinearMPC
from .estimator import DisturbanceEstimator as DisturbanceEstimator
from .estimator import EstimatingMPC as EstimatingMPC
from .estimator import EstimatorSettings as EstimatorSettings
from .estimator import ExtendedKalmanFilter as ExtendedKalmanFilter
from .estimator import StateEstimate as StateEstimate
from .settings import MPCSettings as MPCSettings
from .settings import control_horizon as control_horizon
