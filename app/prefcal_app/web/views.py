"""Encode what a page shows as JSON, once for all tabs that show the same version."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from prefcal_app.session import Given, Interview
from prefcal_app.view import (
    Seen,
    asked_view,
    brief_view,
    history_view,
    look_view,
    map_view,
    now_view,
    preview_view,
    status_view,
)

from .reports import Reports

PLAIN: Mapping[str, Callable[[Interview], Any]] = MappingProxyType(
    {"brief": brief_view, "history": history_view, "status": status_view}
)
"""Views that follow from the interview alone: what a study is about, and where it is."""


@dataclass(slots=True)
class Views:
    """The views of one interview, encoded as JSON.

    Args:
        interview: Interview to show.
        reports: Location of its report, known at the end.
        again: Command that resumes the study.
        command: Command that repeats the study from the start.
    """

    interview: Interview
    reports: Reports
    again: str = ""
    command: str = ""
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _drawing: threading.Lock = field(default_factory=threading.Lock)
    _seen: Seen = field(default_factory=Seen)
    _simulated: tuple[int, bytes] | None = None
    _kept: dict[bool, tuple[Any, bytes]] = field(default_factory=dict)

    def now(self, blind: bool) -> bytes:
        """Return NOW, made once per version: an answer must not wait for other tabs."""
        with self._lock:
            key = (self.interview.now().version, self.reports.folder)
            kept = self._kept.get(blind)
            if kept is None or kept[0] != key:
                kept = self._kept[blind] = (key, encoded(self._now(blind)))
            return kept[1]

    def plain(self, name: str) -> bytes:
        """Return one of the views `PLAIN`."""
        return encoded(PLAIN[name](self.interview))

    def preview(self, given: Given) -> bytes:
        """Return what would be saved of a record."""
        return encoded(preview_view(self.interview, given))

    def asked(self, answer: int, blind: bool) -> bytes:
        """Return an answered question as it was shown."""
        with self._lock:  # all threads share `_seen`
            view = asked_view(self.interview, answer, blind=blind, seen=self._seen)
        return encoded(view)

    def simulated(self) -> bytes:
        """Return the simulated θ, made once per version; null until the agent knows them."""
        with self._drawing:
            version = self.interview.now().version
            if self._simulated is None or self._simulated[0] != version:
                self._simulated = (version, encoded(map_view(self.interview)))
            return self._simulated[1]

    def look(self, theta: tuple[float, ...]) -> bytes:
        """Return a simulated θ beside the best so far."""
        return encoded(look_view(self.interview, theta))

    def _now(self, blind: bool) -> dict[str, Any]:
        return now_view(
            self.interview, blind=blind, again=self.again, command=self.command,
            report=self.reports.folder, seen=self._seen,
        )  # fmt: skip


def encoded(view: Any) -> bytes:
    """Return JSON in UTF-8; NaN and infinite numbers become null."""
    return msgspec.json.encode(view, enc_hook=_plain)


def _plain(number: np.generic) -> Any:
    return number.item()
