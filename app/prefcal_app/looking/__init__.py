"""Look at any two runs side by side, from files, studies or Python, without a study."""

from .look import SideBySide as SideBySide
from .look import look as look
