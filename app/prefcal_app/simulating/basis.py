"""What the open question was chosen from: the simulated θ, and why this one is shown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_agents.registry import CLASSES
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.certificate import Certificate
from prefcal_agents.screening.reason import Reason, RobustResult
from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.influence import Influence, decisive
from prefcal_agents.utility.smaller_change import SmallerChange
from prefcal_env.preferences.history import History, Sample


@dataclass(frozen=True, eq=False, slots=True)
class Carried:
    """What carries a result, and what is near it. It is worked out while nobody waits.

    Args:
        over: Whether it is about the result of a study that is over.
        stakes: Chance that the answer to the open question changes the best; None without one.
        decisive: The doubtful answer that carries the result; None if none alone does.
        menu: Rows of the bank that the person might prefer to the result, with the KPIs they gain.
        wishes: KPIs that the person wanted better by the answers, with how sure that is.
        robustness: How the result of a robust study holds, and what that costs.
        smaller: The result with knobs as in the current tuning; None if none can be.
        complete: Whether `smaller` is worked out, which takes more simulations.
    """

    over: bool
    stakes: float | None
    decisive: Influence | None
    menu: Mapping[int, Sequence[str]]
    wishes: Mapping[str, float]
    robustness: RobustResult | None = None
    smaller: SmallerChange | None = None
    complete: bool = True

    @classmethod
    def of(cls, agent: Screening, *, over: bool) -> "Carried":
        """Return what is to be said of the open question or, if the study is over, of the result."""
        if not over:
            return cls(False, agent.stakes, None, {}, {})
        best = agent.best_index
        found = None if best is None else decisive(agent.influences, best)
        named = found if found and found.doubtful else None
        told = named, agent.menu, agent.wishes, agent.robustness
        return cls(True, None, *told, complete=not agent.setup.start)


@dataclass(frozen=True, eq=False, slots=True)
class Basis:
    """What a question was chosen from.

    Args:
        past: Record that it follows from: samples and answers before the question.
        pending: Its challenger; None for a follow-up question and after the last one.
        bank: Simulated θ with their KPIs.
        reason: Why its challenger is shown; None without a comparison.
        chance_of_better: Probability that the person prefers the most promising simulated θ.
        trend: How expected worth grows along each knob near the best; None if it is not known.
        certificate: What can be said of the best so far; None while nothing can.
        carried: What carries the result; None while it is not worked out.
    """

    past: History
    pending: Sample | None
    bank: Bank
    reason: Reason | None
    chance_of_better: float
    trend: Float[np.ndarray, " n"] | None = None
    certificate: Certificate | None = None
    carried: Carried | None = None

    def completed(self, agent: Screening) -> "Basis":
        """Return this with the smaller change that `agent` simulates, which is then in the bank."""
        assert self.carried is not None
        smaller = agent.smaller_change
        bank = self.bank if smaller is None else agent.with_simulated(np.array([smaller.theta]))
        return replace(self, bank=bank, carried=replace(self.carried, smaller=smaller, complete=True))

    @classmethod
    def of(cls, agent: Screening) -> "Basis":
        """Return the basis of the open question of `agent`, which simulates what is missing."""
        bank, reason = agent.bank, None if agent.done else agent.reason
        pending = agent.history.pending
        chance, trend = agent.chance_of_better, agent.trend
        return cls(past_of(agent), pending, bank, reason, chance, trend, agent.certificate)


def past_of(agent: Agent) -> History:
    """Return the record that the open question follows from, without its own sample."""
    return agent.history.until(agent.history.answered)


@dataclass(frozen=True, slots=True)
class Simulated:
    """Numbers of what a study simulated unseen and what it showed.

    Args:
        simulated: Number of θ simulated so far, for the open question; 0 if it is not known.
        planned: Number of θ to simulate in the whole study.
        failed: Number of simulations that failed.
        shown: Number of experiments that were shown or are on show.
        twin: Whether θ are simulated on a twin of the plant that runs what is shown.
        due: Number of θ to simulate before the next question; 0 if nothing is simulated now.
    """

    simulated: int
    planned: int
    failed: int
    shown: int
    twin: bool = False
    due: int = 0

    @property
    def going_on(self) -> str:
        """Return what is simulated for the next question: "120 of 280 simulated"; empty if all."""
        if self.simulated >= self.due:
            return ""
        return f"{self.simulated} of {self.due} simulated{' on the twin' if self.twin else ''}"

    @property
    def line(self) -> str:
        """Return the numbers as one line: "412 simulated, 6 shown"."""
        where = " on the twin" if self.twin else ""
        words = f"{self.simulated} simulated{where}, {self.shown} shown"
        if not self.failed:
            return words
        return f"{words}, {self.failed} simulation{'' if self.failed == 1 else 's'} failed"


def simulates(agent: Agent) -> bool:
    """Return whether `agent` chooses from simulations that nobody looks at."""
    row = CLASSES.get(type(agent).__name__)
    return row is not None and row.simulates
