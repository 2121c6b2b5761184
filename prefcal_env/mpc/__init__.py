"""Model predictive control: eq. MPC on a linearized plant."""

from .computation import Processor as Processor
from .computation import StepSize as StepSize
from .controller import LinearMPC as LinearMPC
from .estimating import DisturbanceEstimator as DisturbanceEstimator
from .estimating import EstimatingMPC as EstimatingMPC
from .estimating import EstimatorSettings as EstimatorSettings
from .estimator import Estimate as Estimate
from .estimator import ExtendedKalmanFilter as ExtendedKalmanFilter
from .processors import TimedStep as TimedStep
from .processors import fit_processor as fit_processor
from .processors import read_processor as read_processor
from .processors import write_processor as write_processor
from .settings import MPCSettings as MPCSettings
from .settings import control_horizon as control_horizon
