"""Seed the global random state for libraries that draw from it, and restore it afterwards."""

import random
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

import numpy as np

_ONE_AT_A_TIME = RLock()


@contextmanager
def seeded(*key: int) -> Iterator[int]:
    """Seed numpy's and Python's global generators by `key` inside the context, then restore them.

    Two agents in one process therefore do not disturb each other or the caller's own draws. Only
    one thread at a time can enter.

    Args:
        key: Integers, each 0 or more, such as a seed and a counter.

    Yields:
        A seed below 2**32 that follows from `key`, for a library's own generator.
    """
    numpy_words, *other = np.random.SeedSequence(key).spawn(3)
    python_seed, library_seed = (int(words.generate_state(1)[0]) for words in other)
    with _ONE_AT_A_TIME:
        numpy_state, python_state = np.random.get_state(), random.getstate()  # noqa: NPY002
        fresh = np.random.RandomState(np.random.MT19937(numpy_words))
        try:
            np.random.set_state(fresh.get_state())  # noqa: NPY002
            random.seed(python_seed)
            yield library_seed
        finally:
            np.random.set_state(numpy_state)  # noqa: NPY002
            random.setstate(python_state)
