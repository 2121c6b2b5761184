"""Run the interview, an agent's questions and a person's answers, without a front end.

The page, the terminal and unattended runs drive the same `Interview`. Whatever it acknowledges is
already in the study file. What a person can do is in `actions`.
"""

from prefcal_app.simulating import SimulationCounts as SimulationCounts
from prefcal_app.summary import Consistency as Consistency
from prefcal_app.summary import Counts as Counts
from prefcal_app.summary import Outlook as Outlook

from . import actions as actions
from .actions import Preview as Preview
from .interview import Interview as Interview
from .study import Choice as Choice
from .study import Now as Now
from .study import Phase as Phase
from .study import Question as Question
from .study import Side as Side
from .unattended import Background as Background
from .unattended import unattended as unattended
