"""A run on a live plant as a `Run`: look, ask a person, then drive; and what restores the plant."""

import threading
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ConnectionLostError, LiveError, RunError
from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.sources.run import Change, LiveCurve, Progress, Run, Stage, Table

if TYPE_CHECKING:
    from .rig import LiveRig

_DRAWN = 400
"""Largest number of samples that a live curve shows."""


class _Followed(Run):
    """A run that can be followed while another thread drives the plant."""

    def __init__(self, rig: "LiveRig") -> None:
        self._rig = rig
        self._stop, self._closing = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._rows: list[Progress] = []

    @property
    def recorded(self) -> tuple[tuple[float, ...], tuple[LiveCurve, ...]]:
        with self._lock:
            rows = self._rows[:: max(1, -(-len(self._rows) // _DRAWN))]
        tags = self._rig.tags
        referenced = {tag.name for tag in tags if tag.role == "reference"}
        curves = tuple(
            LiveCurve(
                tag,
                tuple(row.values[tag.key] for row in rows),
                tuple(row.values[f"reference {tag.name}"] for row in rows if tag.name in referenced),
            )
            for tag in tags
            if tag.role == "output"
        )
        return tuple(row.elapsed for row in rows), curves

    def stop(self, why: str, within: float = 0.0) -> None:
        """Stop: the old values are restored, if the process ends, at the next start."""
        self.stopping = self.stopping or why == "stopped"
        (self._stop if why == "stopped" else self._closing).set()

    def _tell(self, progress: Progress) -> None:
        self.progress = progress
        if progress.stage is Stage.RECORDING:
            with self._lock:
                self._rows.append(progress)
        self.changed()


class LiveRun(_Followed):
    """A run of θ: it looks at the plant, waits until a person confirms the changes, and drives.

    Args:
        rig: Live rig.
        theta: Physical θ, shape (n,).
    """

    def __init__(self, rig: "LiveRig", theta: Float[np.ndarray, " n"]) -> None:
        super().__init__(rig)
        self._theta = theta
        self._agreed: tuple[Change, ...] | None = None

    def supply(self, given: Table | tuple[Change, ...]) -> None:
        """Let the run start with the changes that a person confirmed."""
        if not given or not isinstance(given, tuple):
            raise LiveError(self.problem or "nothing was confirmed")
        self._agreed, self.problem = given, ""
        self.waits, self.moves_plant = False, True
        self.progress = Progress(Stage.CONNECTING, 0.0, 0.0)

    def advance(self) -> Experiment | None:
        """Look at the plant or, once the changes are confirmed, run θ and return what it recorded.

        Raises:
            RunError: If the run failed; `partial` holds what was recorded until then.
            LiveError: If another process runs on the plant, or it lacks its old values.
        """
        if self._agreed is None:
            self._look()
            return None
        agreed = self._agreed
        try:
            driven = self._rig.drive(
                self._theta,
                lambda changes: changes == agreed,
                stop=self._stop.is_set,
                closing=self._closing.is_set,
                tell=self._tell,
            )
        finally:
            self.progress = None
        made = driven.experiment
        self.partial = made if len(made.t) else None
        if not (driven.restored or driven.kept):
            self.problem = (
                f"the plant does not have its old values yet: {driven.problem}. They are restored first"
            )
        if not driven.why or made.end is not End.FAILED:
            return made
        restored = "The old values are restored" if driven.restored else self.problem
        raise RunError(f"{driven.why}. {restored}.", "stopped" if driven.stopped else "raised")

    def _look(self) -> None:
        try:
            self.changes = self._rig.look(self._theta) or None
        except ConnectionLostError as error:
            self.problem = f"the server is not reachable: {error}"
        except LiveError as error:
            self.problem = str(error)
        self.waits = True


class RestoringRun(_Followed):
    """Restores what an interrupted run left on the plant; it has no experiment."""

    def advance(self) -> None:
        """Restore the old values.

        Raises:
            LiveError: If another process runs on the plant, or it refuses its old values.
        """
        try:
            self._rig.recover(closing=self._closing.is_set, tell=self._tell)
        finally:
            self.progress = None
