"""Look at any two runs side by side, from files, studies or Python, without a study."""

from .look import Look as Look
from .look import look as look
