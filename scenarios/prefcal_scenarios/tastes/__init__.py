"""Tastes: people with known wishes who compare closed loops, and what a tuning is worth to them."""

from .runs import Runs as Runs
from .runs import runs_of as runs_of
from .sample import fingerprint as fingerprint
from .sample import is_cached as is_cached
from .sample import sample as sample
from .taste import TASTES as TASTES
from .taste import VERSION as VERSION
from .taste import Taste as Taste
from .taste import has_cost as has_cost
from .taste import taste as taste
from .worth import random_search_worth as random_search_worth
from .worth import worth as worth
