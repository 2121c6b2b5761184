"""The interview: an agent's questions and a person's answers, free of any front end.

Page, terminal and unattended run drive the same `Interview`; whatever it acknowledges stands in
the study file already.
"""

from .background import Background as Background
from .consistency import Consistency as Consistency
from .counts import Counts as Counts
from .interview import Interview as Interview
from .moment import Choice as Choice
from .moment import Now as Now
from .moment import Phase as Phase
from .moment import Question as Question
from .moment import Side as Side
from .outlook import Outlook as Outlook
from .records import Given as Given
from .records import Preview as Preview
from .unattended import unattended as unattended
