"""An agent of your own in one file: a random step away from the best θ, kept if preferred."""

import numpy as np

from prefcal_agents.agent import Agent


class StepSearch(Agent):
    """Evolution strategy with one parent; steps grow after a success and shrink after a failure.

    The base class does the bookkeeping: the open question, the incumbent, undo, retraction, saving.
    What is left is one pure function, from what was tried and answered to the next point of the
    unit cube. If its θ ran already, a random one takes its place.
    """

    version = 1  # raise it when the same answers would lead to another next sample

    def propose(self, history):
        n, n_init = len(self.space), self.setup.n_init
        rng = np.random.default_rng([self.setup.seed, history.answered])  # nothing else to remember
        if history.answered < n_init:
            return rng.random(n)
        answers = [c.answer.preference for c in history.lessons[n_init - 1 :]]  # -1: it won
        step = min(0.2 * 1.5 ** answers.count(-1) * 0.9 ** answers.count(1), 0.5)
        parent = np.array(history.samples[history.incumbent].z)
        return np.clip(parent + step * rng.standard_normal(n), 0.0, 1.0)


if __name__ == "__main__":
    from prefcal_bench.problems.functions import FUNCTIONS

    camel = FUNCTIONS["camel"]
    agent = StepSearch(camel.space, n_max=50, seed=0)
    while not agent.done:
        query = agent.ask()
        new, best = query.challenger, query.incumbent
        agent.tell(query, None if best is None else camel.prefer(new.theta, best.theta))
    print("best θ:", camel.space.named(agent.best), "gap:", round(camel.gap(agent.best), 4))
