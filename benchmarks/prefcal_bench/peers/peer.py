"""What all agents share whose samples another package proposes: the start, and a repeatable run."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Agent
from prefcal_agents.search import Tried, latin_hypercube
from prefcal_bench.extras import load
from prefcal_bench.global_random import seeded
from prefcal_env.preferences.history import History


class Peer(Agent):
    """An agent whose first samples are a Latin hypercube, and all others those of a package.

    If the package proposes none, the sample is random.
    """

    _modules: ClassVar[tuple[str, ...]]  # modules of the extra `peers` without which the agent cannot be made

    def _prepare(self) -> None:
        for module in self._modules:
            load(module, "peers")

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point: of the start, or what the package proposes."""
        index, tried = history.answered, Tried(self.space, history)
        rng = np.random.default_rng([self.setup.seed, index])
        z = self._planned(index)
        if z is None:
            z = self._proposal(history, tried)
        if z is None:
            z = rng.random(len(self.space))
        return tried.fresh(np.clip(z, 0.0, 1.0), rng)

    def _planned(self, index: int) -> Float[np.ndarray, " n"] | None:
        """Return the sample of the start with this index; None after the start."""
        if index >= self.setup.n_init:
            return None
        return np.asarray(latin_hypercube(self.space, self.setup.n_init, self.setup.seed)[index])

    def _proposal(self, history: History, tried: Tried) -> Float[np.ndarray, " n"] | None:
        """Return what the package proposes, about in the unit cube, shape (n,); None for nothing."""
        raise NotImplementedError


@contextmanager
def alone() -> Iterator[None]:
    """Limit linear algebra to one thread in the context, and ignore warnings.

    So a proposal has the same digits whatever else the machine does.
    """
    from threadpoolctl import threadpool_limits  # finds libraries that torch loaded

    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@contextmanager
def torch_seeded(*key: int) -> Iterator[int]:
    """Run torch alone, with all global generators seeded by `key`, then restore these.

    Args:
        key: Integers, each 0 or more, such as a seed and a counter.

    Yields:
        A seed below 2**32 that follows from `key`, for a generator of a library.
    """
    torch = load("torch", "peers")
    with seeded(*key) as seed, torch.random.fork_rng(devices=[]), alone():
        torch.default_generator.manual_seed(seed)
        yield seed
