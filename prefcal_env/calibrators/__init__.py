"""Calibrators: synthetic ones that follow a rule, and people who are asked from Python."""

from .human import HumanCalibrator as HumanCalibrator
from .latent_cost import BradleyTerry as BradleyTerry
from .latent_cost import Flipping as Flipping
from .latent_cost import LatentCost as LatentCost
from .latent_cost import Noise as Noise
from .latent_cost import Thurstone as Thurstone
from .lexicographic import Criterion as Criterion
from .lexicographic import Lexicographic as Lexicographic
