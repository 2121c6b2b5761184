"""Calibrators: synthetic ones, which answer from a rule, and a person in Python."""

from prefcal_env.calibrators.human import HumanCalibrator as HumanCalibrator
from prefcal_env.calibrators.latent_cost import LatentCost as LatentCost
from prefcal_env.calibrators.lexicographic import Criterion as Criterion
from prefcal_env.calibrators.lexicographic import Lexicographic as Lexicographic
from prefcal_env.calibrators.noise import BradleyTerry as BradleyTerry
from prefcal_env.calibrators.noise import Flipping as Flipping
from prefcal_env.calibrators.noise import Noise as Noise
from prefcal_env.calibrators.noise import Thurstone as Thurstone
