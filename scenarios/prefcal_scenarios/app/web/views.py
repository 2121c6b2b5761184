"""What a page is shown, as JSON: made at most once for all tabs that look at the same moment."""

import json
import math
import threading
from dataclasses import dataclass, field
from typing import Any

from prefcal_scenarios.app.session import Given, Interview

from .reports import Reports
from .view import Seen, asked_view, brief_view, history_view, now_view, preview_view, status_view


@dataclass(slots=True)
class Views:
    """The views of one interview, encoded.

    Args:
        interview: What is shown.
        reports: Where its report is, at the end.
        again: The command that takes the study up again.
        command: The command that repeats it from the start.
    """

    interview: Interview
    reports: Reports
    again: str = ""
    command: str = ""
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _seen: Seen = field(default_factory=Seen)
    _kept: dict[bool, tuple[Any, bytes]] = field(default_factory=dict)

    def now(self, blind: bool) -> bytes:
        """NOW. Made once for each version: an answer must not wait for 40 tabs to be drawn."""
        with self._lock:
            key = (self.interview.now().version, self.reports.folder)
            kept = self._kept.get(blind)
            if kept is None or kept[0] != key:
                kept = self._kept[blind] = (key, encoded(self._now(blind)))
            return kept[1]

    def brief(self) -> bytes:
        """What the task is."""
        return encoded(brief_view(self.interview))

    def preview(self, given: Given) -> bytes:
        """What would be saved of a record."""
        return encoded(preview_view(self.interview, given))

    def history(self) -> bytes:
        """Every question and answer."""
        return encoded(history_view(self.interview))

    def asked(self, answer: int, blind: bool) -> bytes:
        """A closed question, as it was shown."""
        with self._lock:  # what was seen is one for all threads
            view = asked_view(self.interview, answer, blind=blind, seen=self._seen)
        return encoded(view)

    def status(self) -> bytes:
        """Where we are."""
        return encoded(status_view(self.interview, report=self.reports.folder))

    def _now(self, blind: bool) -> dict[str, Any]:
        return now_view(
            self.interview, blind=blind, again=self.again, command=self.command,
            report=self.reports.folder, seen=self._seen,
        )  # fmt: skip


def encoded(view: Any) -> bytes:
    """JSON in UTF-8. Numbers that JSON does not have become null."""
    try:
        return _dump(view)
    except ValueError:
        return _dump(_finite(view))


def _dump(view: Any) -> bytes:
    return json.dumps(view, allow_nan=False, separators=(",", ":")).encode()


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
