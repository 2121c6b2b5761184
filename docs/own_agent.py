"""An agent of your own in one file: a random step away from the best θ, kept if preferred."""

import numpy as np

from prefcal_agents.history.lessons import Preferences
from prefcal_agents.protocol.agent import PreferenceBased
from prefcal_agents.protocol.session import Session
from prefcal_agents.space.design import Tried
from prefcal_agents.support.checks import integer

VERSION = 1  # raise it when the same answers would lead to another next sample


class StepSearch(PreferenceBased):
    """Evolution strategy with one parent; steps grow after a success and shrink after a failure.

    `Session` does the bookkeeping: the open question, the incumbent, undo, retraction. What is left
    is one function, from what was tried and answered to the next point of the unit cube.
    """

    def __init__(self, space, *, n_init=10, n_max=50, seed=0):
        integer("seed", seed, low=0)
        self._seed = int(seed)
        self._session = Session(space, n_init, n_max, self._propose)

    def _propose(self, history):
        rng = np.random.default_rng([self._seed, history.answered])  # nothing else to remember
        n = len(self.space)
        if history.answered < self.n_init:
            z = rng.random(n)
        else:
            lessons = Preferences.of(history)
            won = np.sum(lessons.b[self.n_init - 1 :] == -1)
            lost = np.sum(lessons.b[self.n_init - 1 :] == 1)
            step = min(0.2 * 1.5**won * 0.9**lost, 0.5)
            parent = np.array(history.samples[history.incumbent].z)
            z = np.clip(parent + step * rng.standard_normal(n), 0.0, 1.0)
        return Tried(self.space, history).fresh(z, rng)  # nothing is tried twice

    @property
    def state(self):
        """Return the state to save."""
        self._session.settle()
        return self._session.state("StepSearch", VERSION, self._seed)


if __name__ == "__main__":
    from prefcal_scenarios.cases.functions import FUNCTIONS

    camel = FUNCTIONS["camel"]
    agent = StepSearch(camel.space, n_max=50, seed=0)
    while not agent.done:
        query = agent.ask()
        new, best = query.challenger, query.incumbent
        agent.tell(query, None if best is None else camel.prefer(new.theta, best.theta))
    print("best θ:", camel.space.named(agent.best), "gap:", round(camel.gap(agent.best), 4))
