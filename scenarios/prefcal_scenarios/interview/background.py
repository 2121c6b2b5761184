"""The thread that runs an interview's experiments while a person looks at the last one."""

import threading
from types import TracebackType
from typing import Self

from .interview import Interview


class Background:
    """Runs `interview.work` in one thread of its own: a plant is never run twice at once."""

    def __init__(self, interview: Interview) -> None:
        self._interview = interview
        # A daemon: an experiment that takes an hour must not keep a closed program alive.
        self._thread = threading.Thread(target=self._loop, name="experiments", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._interview.close()
        self._thread.join(timeout=1.0)

    def _loop(self) -> None:
        while self._interview.work() or self._interview.wait_for_work():
            pass
