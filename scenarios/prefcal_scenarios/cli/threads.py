"""Linear algebra on one thread, said before numpy is loaded: it reads the environment once."""

import os


def one_thread() -> None:
    """Keep linear algebra on one thread, unless the user has said otherwise.

    Our matrices are small: threads spend twice the time, most of it waiting for each other.
    """
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
