"""Problems on which agents are compared, and who answers there."""

from .cases import CSTR_BROAD as CSTR_BROAD
from .cases import CSTR_HOLE as CSTR_HOLE
from .cases import GUIDELINES as GUIDELINES
from .cases import HOLES as HOLES
from .catalog import CALIBRATORS as CALIBRATORS
from .catalog import PROBLEMS as PROBLEMS
from .catalog import problem as problem
from .problem import NOISES as NOISES
from .problem import Judge as Judge
from .problem import JudgeFactory as JudgeFactory
from .problem import Outcome as Outcome
from .problem import Person as Person
from .problem import Problem as Problem
from .problem import judges as judges
from .problem import prefer as prefer
