"""Run an interview's experiments in a thread while a person looks at the last one."""

import threading
from contextlib import suppress
from typing import Self

from prefcal_env.workers import GRACE

from .interview import Interview
from .study.now import Phase

_DRAWN = 0.15
"""Seconds left for sending and drawing a new question before prefetching starts."""


class Background:
    """Threads that run `interview.work`, one for each experiment that may run at the same time."""

    def __init__(self, interview: Interview) -> None:
        self._interview = interview
        # A daemon, since an hour-long experiment must not keep a closed program alive.
        self._threads = [
            threading.Thread(target=self._loop, name="experiments", daemon=True)
            for _ in range(interview.at_once)
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._interview.close()
        while self._interview.drives and self._threads[0].is_alive():
            self._threads[0].join(timeout=0.2)  # the live plant gets its old values back
        for thread in self._threads:
            thread.join(timeout=1.0 + GRACE)

    def _loop(self) -> None:
        # An error of the compiler occurs again in the first experiment, which shows it.
        with suppress(Exception):
            self._interview.prepare()
        seen = None
        while True:
            now = self._interview.now()
            if now.phase is Phase.QUESTION and now.question is not seen:
                seen = now.question
                self._interview.wait(now.version, _DRAWN)
            if not (self._interview.work() or self._interview.wait_for_work()):
                return
