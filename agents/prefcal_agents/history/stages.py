"""Work out what is known after a record, answer by answer, and remember it."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import Generic, TypeVar, final

from prefcal_env.preferences.history import History

_REMEMBERED = 40
"""Number of stages in memory, up to about a megabyte each."""
_SELDOM = 10
"""Number of answers of a long step."""
_LATEST = 16
"""Number of results in memory: those of the likely answers to a question and of an undo."""

Known = TypeVar("Known")


@final
class Remembered(Generic[Known]):
    """A function of a record that remembers what it returned for the latest ones.

    Records are compared, not hashed: those of a study share their parts, so that takes no time.

    Args:
        function: Function of a record that returns something else than None.
    """

    def __init__(self, function: Callable[[History], Known]) -> None:
        self._function = function
        self._latest: tuple[tuple[History, Known], ...] = ()  # frozen, since threads share it

    def __call__(self, history: History) -> Known:
        """Return what the function returns for `history`."""
        known = self.get(history)
        if known is None:
            known = self._function(history)
            self._latest = ((history, known), *self._latest[: _LATEST - 1])
        return known

    def get(self, history: History) -> Known | None:
        """Return it if it is remembered; None otherwise."""
        return next((known for past, known in self._latest if past == history), None)


@final
class Stages(Generic[Known]):
    """What is known after each answer, which follows from what was known one answer earlier.

    It is a function of the record, so nothing has to be saved, and copies of an agent share it:
    memory only saves time.

    Args:
        first: Function that returns what is known before the first answer.
        following: Function of a record, the record one step earlier, and what was known then. A
            step is a new experiment with its answer, or all follow-up answers after it.
        most: Number of answers after which steps are long: ten answers at once, and the rest. This
            saves time when a long study is opened. With None, they never are.
        whole: Whether a new experiment and all follow-up answers after it are one step.
    """

    def __init__(
        self,
        first: Callable[[], Known],
        following: Callable[[History, History, Known], Known],
        most: int | None = None,
        *,
        whole: bool = False,
    ) -> None:
        self._first, self._following, self._most, self._whole = first, following, most, whole
        self._known: OrderedDict[History, Known] = OrderedDict()

    def after(self, history: History) -> Known:
        """Return what is known after `history`."""
        past = history.until(history.answered).bare()
        before, known = self._latest(past)
        for count in self._steps(before.answered + 1, past.answered):
            here = past.until(count)
            alone = here if self._whole else replace(here, follow_ups=before.follow_ups)
            known = self._kept(alone, before, known)
            if here != alone:
                known = self._kept(here, alone, known)
            before = here
        return known

    def knows(self, history: History) -> bool:
        """Return whether what is known after `history` is in memory."""
        return history.until(history.answered).bare() in self._known

    def _steps(self, start: int, end: int) -> list[int]:
        """Return the numbers of answers from `start` to `end` at which a step ends."""
        most = end if self._most is None else self._most
        return [k for k in range(start, end + 1) if k <= most or k % _SELDOM == 0 or k == end]

    def _latest(self, past: History) -> tuple[History, Known]:
        """Return the latest part of `past` that is in memory, and what is known after it.

        Earlier ones may be forgotten: to work them out again would take time for each answer.
        """
        for count in reversed(self._steps(1, past.answered)):
            here = past.until(count)
            known = self._known.get(here)
            if known is not None:
                return here, known
        known = self._known.get(History())
        return History(), self._remembered(History(), self._first() if known is None else known)

    def _kept(self, past: History, before: History, known: Known) -> Known:
        found = self._known.get(past)  # another thread may drop it at any time
        return found if found is not None else self._remembered(past, self._following(past, before, known))

    def _remembered(self, past: History, known: Known) -> Known:
        self._known[past] = known
        while len(self._known) > _REMEMBERED:
            self._known.popitem(last=False)
        return known
