"""One tree of plain data (dicts that JSON holds) that page, terminal, notebook, look and report draw.

Its branches: `brief` the task, its knobs and KPIs; `now` the phase, the progress, the open question
with both sides, and at the end what was gained; `history` every answer; `status` the best so far,
what was tried and learned, and whether to continue; `simulated` what was simulated unseen. Two
experiments beside each other are put together in `sides`, and tables in `tables`, and nowhere else.
"""

from .brief import brief_view as brief_view
from .brief import scenario_view as scenario_view
from .history import asked_view as asked_view
from .history import history_view as history_view
from .now import now_view as now_view
from .preview import preview_view as preview_view
from .seen import Seen as Seen
from .sides import question_view as question_view
from .simulated import look_view as look_view
from .simulated import map_view as map_view
from .simulated import why_view as why_view
from .status import status_view as status_view
