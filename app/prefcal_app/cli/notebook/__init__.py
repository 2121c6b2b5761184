"""Ask inside a notebook: the page of a study in a frame below the cell, and the study in Python."""

from .asking import Asking as Asking
from .asking import ask as ask
