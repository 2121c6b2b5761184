"""One tree of plain data (dicts that JSON holds) that page, terminal, notebook, look and report draw.

Its branches: `brief` the task, its knobs and KPIs; `now` the phase, the progress, the open question
with both sides, and at the end what was gained; `history` every answer; `status` the best so far,
what was tried and learned, and whether to continue; `simulated` what was simulated unseen. Two
experiments beside each other are put together in `sides`, and tables in `tables`, and nowhere else.
"""

from .end import look_view as look_view
from .end import map_view as map_view
from .end import trial_view as trial_view
from .end import why_view as why_view
from .now import asked_view as asked_view
from .now import history_view as history_view
from .now import now_view as now_view
from .now import status_view as status_view
from .question import Seen as Seen
from .question import brief_view as brief_view
from .question import preview_view as preview_view
from .question import question_view as question_view
from .question import scenario_view as scenario_view
