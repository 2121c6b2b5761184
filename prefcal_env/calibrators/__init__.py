"""Calibrators: synthetic ones that follow a rule, and people who are asked from Python."""

from .human import HumanCalibrator as HumanCalibrator
from .latent_cost import LatentCost as LatentCost
from .lexicographic import Criterion as Criterion
from .lexicographic import Lexicographic as Lexicographic
from .noise import BradleyTerry as BradleyTerry
from .noise import Flipping as Flipping
from .noise import Noise as Noise
from .noise import Thurstone as Thurstone
