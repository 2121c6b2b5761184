"""What the page is shown: an interview as plain data. The page itself computes nothing of it."""

from .history import asked_view as asked_view
from .history import history_view as history_view
from .now import now_view as now_view
from .status import status_view as status_view
