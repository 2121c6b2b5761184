"""Tastes: people with known wishes who compare closed loops, and what a tuning is worth to them."""

from .named import TASTES as TASTES
from .named import VERSION as VERSION
from .named import WRONG as WRONG
from .named import Taste as Taste
from .named import calibrators_of as calibrators_of
from .named import has_cost as has_cost
from .named import taste as taste
from .runs import Runs as Runs
from .runs import runs_of as runs_of
from .sample import USUAL as USUAL
from .sample import fingerprint as fingerprint
from .sample import is_cached as is_cached
from .sample import sample as sample
from .worth import random_search_worth as random_search_worth
from .worth import worth as worth
