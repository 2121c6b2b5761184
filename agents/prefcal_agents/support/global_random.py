"""Order among libraries that draw from the process's global random state."""

import random
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

import numpy as np

_ONE_AT_A_TIME = RLock()


@contextmanager
def seeded(*key: int) -> Iterator[int]:
    """Inside, numpy's and Python's global generators are seeded by `key`; then they are as before.

    So two agents in one process do not disturb each other, and the caller's own draws come out
    as if nothing had happened. One thread at a time is inside.

    Args:
        key: Integers, each 0 or more: a seed and a counter, say.

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
