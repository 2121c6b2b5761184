"""Model predictive control: eq. MPC on a linearized plant."""

from .controller import LinearMPC as LinearMPC
from .estimating import DisturbanceEstimator as DisturbanceEstimator
from .estimating import EstimatingMPC as EstimatingMPC
from .estimating import EstimatorSettings as EstimatorSettings
from .estimator import Estimate as Estimate
from .estimator import ExtendedKalmanFilter as ExtendedKalmanFilter
from .settings import MPCSettings as MPCSettings
from .settings import control_horizon as control_horizon
