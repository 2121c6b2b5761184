"""One Latin hypercube of all experiments: spreads out, and learns nothing."""

from typing import final

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace
from prefcal_env.preference import Answer, Preference, Query

from .checks import integer
from .cube import Tried, latin_hypercube
from .ledger import Ledger
from .state import AgentState
from .turns import Turns

VERSION = 1
"""Of the algorithm: raised when the same answers would lead to another next sample."""


@final
class LatinHypercube:
    """All `n_max` samples are one Latin hypercube, drawn from `seed` alone.

    Args:
        space: The knobs.
        n_init: Kept for the contract of all agents; 2 or more.
        n_max: Experiments in all, which take n_max - 1 comparisons.
        seed: Of all randomness, 0 or more.

    Raises:
        SettingsError: an impossible value.
    """

    def __init__(
        self, space: KnobSpace, *, n_init: int = 10, n_max: int = 50, seed: int = 0
    ) -> None:
        integer("seed", seed, low=0)
        self._seed = int(seed)
        self._turns = Turns(space, n_init, n_max, self._propose)

    def _propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        index = ledger.answered
        planned = latin_hypercube(self.space, self.n_max, self._seed)[index]
        rng = np.random.default_rng([self._seed, index])
        return Tried(self.space, ledger).fresh(planned, rng)

    @classmethod
    def restore(cls, space: KnobSpace, state: AgentState) -> "LatinHypercube":
        """Carry on from `state`, with the identical next query.

        Raises:
            SettingsError: it is the state of another agent, or does not fit the space.
        """
        state.check("LatinHypercube")
        agent = cls(space, n_init=state.n_init, n_max=state.n_max, seed=state.seed)
        agent._turns.load(state.ledger)
        return agent

    @property
    def state(self) -> AgentState:
        """Everything that has to be saved; the sample of the open query is among it."""
        self._turns.settle()
        return self._snapshot()

    def _snapshot(self) -> AgentState:
        return self._turns.state("LatinHypercube", VERSION, self._seed)

    def copy(self) -> "LatinHypercube":
        """Return an independent twin, for running ahead on each likely answer."""
        return self.restore(self.space, self._snapshot())

    @property
    def space(self) -> KnobSpace:
        """The knobs that θ is made of."""
        return self._turns.space

    @property
    def n_init(self) -> int:
        """Samples of the space-filling start."""
        return self._turns.n_init

    @property
    def n_max(self) -> int:
        """Experiments until the end; fewer than asked for if the space holds fewer θ."""
        return self._turns.n_max

    @property
    def done(self) -> bool:
        """Whether all experiments are answered."""
        return self._turns.done

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """θ of the incumbent, physical, shape (n,). Raises ProtocolError before any answer."""
        return self._turns.best

    @property
    def samples(self) -> Float[np.ndarray, "N n"]:
        """θ of all answered queries, physical, in the order tried, shape (N, n)."""
        return self._turns.samples()

    def ask(self) -> Query:
        """Return the open query, the same until told. Raises ProtocolError when done."""
        return self._turns.ask()

    def tell(self, query: Query, answer: Answer | Preference | int | None) -> None:
        """Close `query`.

        Raises:
            ProtocolError: it is not the open one.
            PreferenceError: `answer` is none of -1, 0, 1, None (can't tell) and an Answer.
        """
        self._turns.tell(query, answer)

    def undo(self) -> None:
        """Take the last answer back and open its query again. Raises ProtocolError if none."""
        self._turns.undo()

    def retract(self, index: int) -> None:
        """Forget what answer `index` (from 0) taught; all samples stay, the open one too.

        Raises:
            ProtocolError: there is no such answer, or it is retracted already.
        """
        self._turns.retract(index)
