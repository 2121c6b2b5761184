"""The compiled parts of the MPC and of its estimator."""
