"""Agents of a user's own, with what goes wrong in them. Loaded as own.py:NAME by the benchmark."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from prefcal_env.preferences.answer import Answer, Query, Suggestion


class Own:
    """A preference-based agent of a few lines, as a user writes it."""

    def __init__(self, space, *, n_init, n_max, seed):
        self.space, self.n_max = space, n_max
        self.rng = np.random.default_rng(seed)
        self.tried, self.winner, self.open = [], None, None

    @property
    def done(self):
        return len(self.tried) >= self.n_max and self.open is None

    @property
    def best(self):
        return self.winner.theta

    def ask(self):
        if self.open is None:
            theta = self.space.decode(self.rng.random(len(self.space)))
            self.tried.append(Suggestion(len(self.tried), theta))
            self.open = Query(self.tried[-1], self.winner)
        return self.open

    def tell(self, query, answer):
        if query.incumbent is None or Answer.of(answer).preference == -1:
            self.winner = query.challenger
        self.open = None


class Sees(Own):
    """The same, told values."""

    def tell(self, query, value):
        self.values = [*getattr(self, "values", []), value]
        self.winner = self.tried[int(np.argmin(self.values))]
        self.open = None


class Simulates(Own):
    """Simulates ten θ and starts with the one of least effort."""

    def __init__(self, space, *, simulate, n_init, n_max, seed):
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        thetas = [space.decode(self.rng.random(len(space))) for _ in range(10)]
        self.tried.append(Suggestion(0, min(thetas, key=lambda theta: simulate(theta)["effort"])))
        self.open = Query(self.tried[0], None)


class Twice(Own):
    """Compares each new θ with the first one, too: two questions an experiment."""

    again = False

    @property
    def done(self):
        return super().done and not self.again

    def ask(self):
        if self.again and self.open is None:
            self.open = Query(self.tried[-1], self.tried[0])
        return super().ask()

    def tell(self, query, answer):
        super().tell(query, answer)
        self.again = not self.again and query.challenger.index > 0


class Prints(Own):
    """Talks too much."""

    def ask(self):
        print("so much to say")
        return super().ask()


class Raises(Own):
    """Breaks down with seed 1."""

    def __init__(self, space, *, n_init, n_max, seed):
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        if seed == 1:
            raise OSError("the pump does not answer")


class Exits(Own):
    """Thinks that it is a program."""

    def ask(self):
        raise SystemExit("bye")


class Quits(Own):
    """Raises what ends programs, by its seed."""

    def ask(self):
        seed = self.rng.bit_generator.seed_seq.entropy
        raise (BaseException, GeneratorExit, KeyboardInterrupt)[seed]("enough")


class Greedy(Own):
    """Wants more than it may have."""

    done = False


class Endless(Own):
    """Asks the first question for ever."""

    done = False

    def tell(self, query, answer):
        self.winner, self.open = self.tried[0], Query(self.tried[0], self.tried[0])


class Forgetful(Own):
    """Gives an experiment another θ the second time."""

    def ask(self):
        if len(self.tried) == 2:
            self.winner = Suggestion(0, self.tried[1].theta)
        return super().ask()


class Skips(Own):
    """Begins with the second experiment."""

    def ask(self):
        return Query(Suggestion(1, super().ask().challenger.theta))


class Outside(Own):
    """Leaves the box."""

    def ask(self):
        query = super().ask()
        return Query(Suggestion(0, query.challenger.theta + 1e3))


class Dies(Own):
    """Kills its process with seed 1, as a crash in compiled code does."""

    def ask(self):
        if self.rng.bit_generator.seed_seq.entropy == 1:
            os._exit(3)
        return super().ask()


class Slow(Own):
    """Takes its time, and leaves a line for each cell that it is made for, if told where."""

    def __init__(self, space, *, n_init, n_max, seed):
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        if "PREFCAL_TEST_LOG" in os.environ:
            with Path(os.environ["PREFCAL_TEST_LOG"]).open("a") as log:
                log.write(f"{seed} {os.getpid()}\n")

    def ask(self):
        time.sleep(0.1)
        return super().ask()


class Murderer(Own):
    """Kills the process that started it, with seed 1."""

    def ask(self):
        if self.rng.bit_generator.seed_seq.entropy == 1:
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60)
        return super().ask()
