"""Model predictive control: eq. MPC on a linearised plant."""

from prefcal_env.mpc.computation import Processor as Processor
from prefcal_env.mpc.computation import StepSize as StepSize
from prefcal_env.mpc.controller import LinearMPC as LinearMPC
from prefcal_env.mpc.settings import MPCSettings as MPCSettings
from prefcal_env.mpc.settings import control_horizon as control_horizon
