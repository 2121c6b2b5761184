"""Compare prefcal with its paper: repeat the case studies, and list every deviation as data."""

from .deviations import DEVIATIONS as DEVIATIONS
from .page import write_page as write_page
from .studies import CASES as CASES
from .studies import Study as Study
from .studies import tasks as tasks
