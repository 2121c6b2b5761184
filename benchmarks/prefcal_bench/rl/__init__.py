"""Provide agents of stable-baselines3, which the extra `rl` of prefcal-bench installs, as baselines."""

from .bandits import PPOBandit as PPOBandit
from .bandits import SACBandit as SACBandit
