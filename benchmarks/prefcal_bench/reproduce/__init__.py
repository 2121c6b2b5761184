"""Compare prefcal with its paper: repeat the case studies, and list every deviation as data."""

from .page import write_page as write_page
from .paper import DEVIATIONS as DEVIATIONS
from .studies import CASES as CASES
from .studies import PaperStudy as PaperStudy
from .studies import tasks as tasks
