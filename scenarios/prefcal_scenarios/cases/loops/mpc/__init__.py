"""Model predictive control of the loops, with an estimator of state and disturbances."""

from .tunable import MPC as MPC
