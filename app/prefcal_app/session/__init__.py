"""Run the interview, an agent's questions and a person's answers, without a front end.

The page, the terminal and unattended runs drive the same `Interview`. Whatever it acknowledges is
already in the study file.
"""

from prefcal_app.simulating import Basis as Basis
from prefcal_app.simulating import Simulated as Simulated
from prefcal_app.summary.consistency import Consistency as Consistency
from prefcal_app.summary.counts import Counts as Counts
from prefcal_app.summary.outlook import Outlook as Outlook

from .background import Background as Background
from .interview import Interview as Interview
from .records import Given as Given
from .records import Preview as Preview
from .study.now import Now as Now
from .study.now import Phase as Phase
from .study.question import Choice as Choice
from .study.question import Question as Question
from .study.question import Side as Side
from .unattended import unattended as unattended
