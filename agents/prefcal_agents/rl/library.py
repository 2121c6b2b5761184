"""Load stable-baselines3 and torch on demand, and seed their global random state."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from prefcal_agents.support.extras import load
from prefcal_agents.support.global_random import seeded


def stable_baselines() -> Any:
    """Return the package. Raises MissingExtraError if the extra `rl` is not installed."""
    return load("stable_baselines3", "rl")


@contextmanager
def torch_seeded(*key: int) -> Iterator[int]:
    """Seed the global generators of torch, numpy and Python by `key` inside the context.

    Afterwards they are restored. Inside, torch uses one thread, which is faster for such small
    networks and gives the same digits whatever else runs.

    Yields:
        A seed below 2**32 that follows from `key`.
    """
    torch = load("torch", "rl")
    with seeded(*key) as seed, torch.random.fork_rng(devices=[]):
        torch.random.default_generator.manual_seed(seed)
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            yield seed
        finally:
            torch.set_num_threads(threads)


def silent(model: Any) -> Any:
    """Give `model` a logger that keeps no log, and return the model."""
    logger = load("stable_baselines3.common.logger", "rl")
    model.set_logger(logger.Logger(None, []))
    return model
