"""Simulate unseen for an agent, on all cores, with a model or a twin, and keep what was simulated."""

import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import zip_longest
from math import nan
from operator import not_
from pathlib import Path
from typing import Any, BinaryIO, Self, final
from zlib import crc32

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Agent
from prefcal_agents.people import Bank
from prefcal_agents.registry import CLASSES
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.bank import ENOUGH
from prefcal_agents.screening.findings import Findings, findings, simulated_for
from prefcal_env.disk import whole_file
from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace, theta_key, theta_keys
from prefcal_env.preferences.answer import Outcome
from prefcal_env.preferences.history import History, Sample
from prefcal_env.study import knobs_as_dicts, within_as_dict
from prefcal_env.study.beside import SIMULATED, head_of, is_ours
from prefcal_env.units import named, same
from prefcal_env.wording import labeled
from prefcal_env.workers import Pool, Terms, in_time, usable_cores
from prefcal_scenarios import verification
from prefcal_scenarios.own import fingerprint, fingerprint_of_code
from prefcal_scenarios.runs import FailedRun, Result, RunTask, all_screened, has_goals, reading
from prefcal_scenarios.scenario import Scenario, with_ranges
from prefcal_scenarios.wording import counted, theta_text

# --- Keep the KPIs of simulated θ in a file beside the study: nothing is simulated twice.


@final
class SimulationFile:
    """The KPIs that a file keeps, and the file that keeps more of them.

    It is a cache: what is damaged, or was simulated by something else, is simulated again, and a
    file that cannot be written keeps nothing.

    Args:
        path: File beside the study.
        key: What the KPIs follow from, see `key_of`.
    """

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._head = path, head_of(SIMULATED, key)
        self._file: BinaryIO | None = None
        self._lines: list[bytes] = []
        self.known: dict[bytes, Outcome] = {}
        """KPIs by the key of θ, none where the run raised an error."""
        self._whole = self._read()

    def add(self, theta: Float[np.ndarray, " n"], kpis: Outcome) -> None:
        """Keep the KPIs of θ, physical, shape (n,)."""
        content = json.dumps([np.asarray(theta, dtype=float).tolist(), dict(kpis)]).encode()
        line = b"%08x %s\n" % (crc32(content), content)
        with suppress(OSError, ValueError):  # no space left, read only, or closed
            if self._file is None:
                self._file = self._opened()
            self._file.write(line)
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _read(self) -> bool:
        """Read the file; return whether more can be added at its end."""
        try:
            head, *lines = self._path.read_bytes().splitlines(keepends=True)
        except (OSError, ValueError, RecursionError):  # none, or empty
            return False
        if head != self._head:
            return False
        for line in lines:
            with suppress(ValueError, KeyError, TypeError):
                theta, kpis = _content(line)
                self.known[theta_key(theta)] = kpis
                self._lines.append(line)
        if not any(self.known.values()):  # what is missing on a machine fails all runs
            self.known, self._lines = {}, []
        return len(self._lines) == len(lines)

    def _opened(self) -> BinaryIO:
        """Open the file to add to it, written anew without what is not usable."""
        if not self._whole:
            if not is_ours(self._path):
                raise ValueError(f"{self._path} is something else")
            with whole_file(self._path) as part:
                part.write_bytes(self._head + b"".join(self._lines))
        return self._path.open("ab")


def _content(line: bytes) -> tuple[list[float], Outcome]:
    """Return θ and its KPIs. Raises ValueError if the line is damaged."""
    checksum, _, content = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or int(checksum, 16) != crc32(content):
        raise ValueError("a damaged line")
    theta, kpis = json.loads(content)
    return theta, Outcome(kpis)


def key_of(
    scenario: Scenario, source: str, configuration: Mapping[str, Any], versions: Mapping[str, str]
) -> str:
    """Return hexadecimal digits that change with everything that simulated KPIs follow from.

    Files that a program reads count only if its code names them.

    Args:
        scenario: Scenario that simulates, with the knobs of the study.
        source: Its name, or path/to/own.py:NAME.
        versions: Versions of the packages that affect results.
    """
    content = {
        "source": fingerprint(source),
        "code": fingerprint_of_code(),
        "seed": configuration["seed"],
        "knobs": knobs_as_dicts(scenario.space),
        "within": within_as_dict(scenario.space),
        "kpis": [(k.name, k.goal, k.at_most, k.at_least) for k in scenario.kpis],
        "versions": dict(versions),
    }
    return sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


# --- A twin: a rough model of the plant, on which θ are simulated that the plant does not run.


def named_twin(configuration: Mapping[str, Any]) -> str | None:
    """Return the name of the twin that a study was started with; None if it has none."""
    name = configuration.get("options", {}).get("twin")
    return None if name is None else str(name)


def twin_of(plant: Scenario, model: Scenario) -> Scenario:
    """Return `model` with the knobs of `plant`, to simulate what the plant does not run.

    Raises:
        SettingsError: If experiments of `model` are no quick simulations, it has other knobs, or
            it lacks a KPI of `plant`.
    """
    if not model.simulated:
        raise SettingsError(
            f"the twin {model.name!r} does not let experiments run unseen: if a run is a quick "
            "simulation, state Scenario(..., simulated=True)"
        )
    ours, theirs = ([labeled(k.name, k.unit) for k in each.space] for each in (plant, model))
    pairs = list(zip_longest(plant.space, model.space))
    if not all(a and b and a.name == b.name and same(a.unit, b.unit) for a, b in pairs):
        raise SettingsError(
            f"the twin {model.name!r} must have the knobs of {plant.name!r} in the same order: "
            f"expected {', '.join(ours)}, got {', '.join(theirs)}"
        )
    known = _kpis(model)
    missing = [name for name in _kpis(plant) if name not in known]
    has = ", ".join(known) or "none with a direction"
    if missing:
        raise SettingsError(
            f"the twin {model.name!r} must have the KPIs of {plant.name!r}: it lacks "
            f"{', '.join(missing)}, and has {has}"
        )
    for kpi in plant.kpis:
        unit = next((k.unit for k in model.kpis if k.name == kpi.name), kpi.unit)
        if not same(unit, kpi.unit):
            raise SettingsError(
                f"the twin {model.name!r} must have the KPIs of {plant.name!r} in the same units: "
                f"{kpi.name!r} is in {named(unit)}, expected {named(kpi.unit)}"
            )
    if has_goals(model) and not has_goals(plant):
        raise SettingsError(
            f"the plant {plant.name!r} must have KPIs with a direction, as its twin {model.name!r} has: {has}"
        )
    return with_ranges(model, plant.space)


def _kpis(scenario: Scenario) -> list[str]:
    """Return the names of the KPIs with a direction, by which people and agents judge."""
    return [kpi.name for kpi in scenario.kpis if kpi.goal is not None]


# --- What the open question was chosen from: the simulated θ, and what is said of it.


@dataclass(frozen=True, eq=False, slots=True)
class Screened:
    """What a screening agent knows after a record."""

    space: KnobSpace  # knobs of the study
    past: History  # record that it follows from: samples and answers before the open question
    # Challenger of that question; None for a follow-up question and after the last one
    pending: Sample | None
    bank: Bank  # simulated θ with their KPIs
    findings: Findings  # what is said of the open question, or of the result

    @classmethod
    def of(cls, agent: Screening, found: Findings | None = None) -> "Screened":
        """Return what `agent` knows, by default of its open question; it simulates what is missing."""
        found = findings(agent) if found is None else found
        bank = simulated_for(agent, found)
        return cls(agent.space, past_of(agent), agent.history.pending, bank, found)

    def row(self, theta: Float[np.ndarray, " n"]) -> int | None:
        """Return the row of the bank that a person cannot tell from θ, shape (n,); None if none.

        An equal one comes first: many θ are not rounded to the same last digits as a single one.
        """
        equal = np.all(self.bank.thetas == theta, axis=1)
        same = equal if equal.any() else self.space.close(theta, self.bank.thetas)
        return int(np.argmax(same)) if same.any() else None


def past_of(agent: Agent) -> History:
    """Return the record that the open question follows from, without its own sample."""
    return agent.history.past


@dataclass(frozen=True, slots=True)
class SimulationCounts:
    """Numbers of what a study simulated unseen and what it showed."""

    simulated: int  # number of θ simulated so far, for the open question; 0 if it is not known
    planned: int  # number of θ to simulate in the whole study
    failed: int  # number of simulations that failed
    shown: int  # number of experiments that were shown or are on show
    twin: bool = False  # whether θ are simulated on a twin of the plant that runs what is shown
    due: int = 0  # number of θ to simulate before the next question; 0 if nothing is simulated now
    # About how long the perturbed runs of a tuning that holds take; 0 if not known, or if there are none
    seconds: float = 0.0
    varied: tuple[int, int] = (0, 0)  # numbers of perturbed runs that arrived, and of all that are due now
    failure: str = ""  # θ of the last simulation that failed, and why; empty if none has, or not known

    @property
    def pace(self) -> str:
        """Return how long a question takes, and why, where people wait for it; else nothing."""
        if self.seconds < _SOON:
            return ""
        about = in_time(float(5 * round(self.seconds / 5) if self.seconds > 10 else round(self.seconds)))
        return (
            f"A question takes about {about} if the first tuning that is tried on {ENOUGH} plants holds "
            "there, and can take several times as long if not."
        )

    @property
    def progress(self) -> tuple[int, int]:
        """Return how much of what is simulated now is there, and all of it; zeros if that is nothing."""
        return (self.simulated, self.due) if self.simulated < self.due else self.varied

    @property
    def going_on(self) -> str:
        """Return what is simulated for the next question: "120 of 280 simulated"; empty if all."""
        done, total = self.progress
        what = "simulated" if self.simulated < self.due else "varied runs"
        return f"{done} of {total} {what}{' on the twin' if self.twin else ''}" if total else ""

    @property
    def line(self) -> str:
        """Return the numbers as one line: "412 simulated, 6 shown"."""
        where = " on the twin" if self.twin else ""
        failed = f", {counted(self.failed, 'simulation')} failed" if self.failed else ""
        return f"{self.simulated} simulated{where}, {self.shown} shown{failed}"


def simulates(agent: Agent) -> bool:
    """Return whether `agent` chooses from simulations that nobody looks at."""
    row = CLASSES.get(type(agent).__name__)
    return row is not None and row.simulates


# --- Simulate θ for an agent: each one once, in worker processes that leave the page its processor.


@final
class RunTimes:
    """How long a run takes: the time between runs that arrive, whatever number of workers they come from."""

    def __init__(self) -> None:
        self._seconds, self._runs, self._since = 0.0, 0.0, nan

    def begin(self) -> None:
        """Begin a batch: what is before its first run is no pace."""
        self._since = nan

    def arrived(self, runs: int, now: float) -> None:
        """Count runs that arrive at a time, in s."""
        if now >= self._since:
            # What was long ago counts less: the machine may have become busier meanwhile.
            part = 0.5 if self._runs >= ENOUGH else 1.0
            self._seconds, self._runs = part * self._seconds + now - self._since, part * self._runs + runs
        self._since = now

    @property
    def seconds(self) -> float:
        """Return the seconds of a run; 0 before enough of them arrived."""
        return self._seconds / self._runs if self._runs >= _MEASURED else 0.0


_TELL = 0.5  # seconds between two reports of progress
_MOST = 8  # largest number of workers unless more are asked for: each takes 100 to 200 MB
_ENDING = 1.0  # seconds to wait for an abandoned batch before its workers are killed
_MEASURED = 20  # number of runs from which their pace counts
_SOON = 3.0  # seconds of a question of which nothing is said

Theta = Float[np.ndarray, " n"]


class Abandoned(Exception):
    """A batch of simulations was given up, since its results are no longer needed."""


@final
class Simulator:
    """What an agent simulates with: `simulate(theta)`, and `many` for a list of θ.

    The results do not depend on the number of workers. A simulation that raises an error, crashes
    or takes too long has failed: it has no KPIs, and is not repeated. KPIs are
    `screened`.

    A scenario of prefcal itself, which always ends, also runs in this process until the first
    worker is ready, so that nobody waits for the workers.

    Args:
        scenario: Scenario with the knobs of the study.
        seed: Seed of every run.
        jobs: Number of workers; None for one for each core, but for a scenario of prefcal one
            less; 0 to run everything in this process.
        longest: Largest time limit of a simulation in seconds, in workers; infinite for none.
        kept: Results of earlier, which are not simulated again, and where new ones are kept.
        robust: Whether agents judge candidates by perturbed runs, too.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int = 0,
        jobs: int | None = None,
        longest: float = np.inf,
        kept: SimulationFile | None = None,
        robust: bool = False,
    ) -> None:
        source = scenario.source.elsewhere
        own = source is not scenario.source
        self.scenario, self.reading = scenario, reading(scenario)
        self.candidates = source.candidates
        directed = has_goals(scenario)
        run = verification.varied_runs.Perturbed(scenario, seed) if robust else source
        margins, judge = {k.name for k in scenario.kpis if k.margin}, verification.varied_runs
        self.holds = partial(judge.which_keep, self.many, self.reading, margins=margins) if robust else None
        self.losses = partial(judge.count_losses, self.many, self.reading, margins=margins)
        self._task = RunTask(run, seed, trajectories=not directed)
        # They are gentle: the page has its processor even if there is a worker on each core. This
        # process runs built-in scenarios, too, until the first worker is ready.
        most = min(usable_cores() if own else max(usable_cores() - 1, 1), _MOST)
        workers = most if jobs is None else jobs
        self._pool = self._task.pool(workers, longest, Terms(gentle=True)) if workers else None
        self._helps, self._kept = not own, kept
        self._known = {} if kept is None else dict(kept.known)
        self.count = sum(map(self._is_nominal, self._known))
        """Number of simulated θ."""
        self.failed = sum(not kpis for key, kpis in self._known.items() if self._is_nominal(key))
        """Number of simulations that failed."""
        self._batch = threading.Lock()  # held while a batch runs
        self._abandoned = False
        self.varied = 0, 0
        """Numbers of perturbed runs that arrived, of all θ that are tried at a time, and that they need."""
        self._times, self._told_at = RunTimes(), 0.0
        self.tell: Callable[[], None] = lambda: None
        """Function that is called during a batch, twice a second, when there is progress."""
        self.failure = ""
        """θ of the last simulation that failed, and why it did; empty if none has."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def busy(self) -> bool:
        """Return whether a batch is being simulated."""
        return self._batch.locked()

    @property
    def seconds(self) -> float:
        """Return about how long the perturbed runs of a θ that holds take, measured; 0 if not known."""
        return ENOUGH * self._times.seconds

    def start(self) -> None:
        """Start the workers, which then load the scenario while something else is done.

        Not if results are kept: there may be nothing left to simulate.
        """
        if self._pool is not None and not self._known:
            self._pool.start()

    def __call__(self, theta: Theta) -> Mapping[str, float]:
        """Return the KPIs of θ, physical, shape (n,), lower is better; none if it failed."""
        return self.many([theta])[0]

    def many(self, thetas: Sequence[Theta]) -> list[Outcome]:
        """Return the KPIs of each θ, in order.

        Raises:
            Abandoned: If `abandon` is called meanwhile. What is known by then stays known.
            ScenarioError: If the workers cannot load the scenario.
        """
        with self._batch:
            keys = theta_keys(np.array(thetas, dtype=float)) if len(thetas) else []
            new = {key: t for key, t in zip(keys, thetas, strict=True) if key not in self._known}
            self._times.begin()
            self.varied = (0, 0) if self.holds is None else self._due(list(new.values()))
            try:
                if self._pool is None:
                    self._here(list(new.values()))
                elif new:
                    self._in(self._pool, new)
            finally:
                self.varied = 0, 0
            return [self._known[key] for key in keys]

    def _due(self, new: Sequence[Theta]) -> tuple[int, int]:
        """Return how many perturbed runs of the θ in a batch are there, and how many they need in all.

        One that is tried alone goes on until the last run, unless it does not hold; several stop to be
        compared.
        """
        n = len(self.scenario.space)
        last = max((int(theta[n]) for theta in new if len(theta) > n), default=0)
        tried = len({theta[:n].tobytes() for theta in new}) if last else 0
        return tried * last - len(new) * bool(last), tried * (ENOUGH if tried == 1 else last)

    def _is_nominal(self, key: bytes) -> bool:
        """Return whether a key is that of a θ, and not that of a perturbed run."""
        return len(key) == len(theta_key(np.zeros(len(self.scenario.space))))

    def resume(self) -> None:
        """Let batches run again after `abandon`."""
        self._abandoned = False

    def abandon(self) -> None:
        """Give up the batch that runs, and any that follows before `resume`, from any thread."""
        self._abandoned = True
        if self._pool is not None:
            self._pool.wake()

    def close(self) -> None:
        """End the workers; nothing can be simulated afterwards."""
        self.abandon()
        waited = self._batch.acquire(timeout=_ENDING)
        try:
            if self._pool is not None:
                self._pool.close()
            if self._kept is not None:
                self._kept.close()
        finally:
            if waited:
                self._batch.release()

    def _here(self, thetas: Sequence[Theta]) -> None:
        """Simulate θ in this process, and keep the results when progress is reported."""
        arrived: list[tuple[Theta, Result]] = []
        try:
            for theta in thetas:
                if self._progress_is_due():
                    self._keep(arrived)
                    arrived.clear()
                    self.tell()
                arrived.append((theta, self._task.here(theta)))
        finally:
            self._keep(arrived)

    def _in(self, pool: Pool, new: Mapping[bytes, Theta]) -> None:
        """Simulate `new` in the workers, and help them until the first is ready."""
        pool.give(list(new.values()))
        left = set(new)
        try:
            while left:
                if self._progress_is_due():
                    self.tell()
                mine = None if pool.loaded or not self._helps else pool.take_back()
                arrived = [] if mine is None else [(mine, self._task.here(mine))]
                arrived += [found[1:] for found in pool.collect(patient=mine is None)]
                left.difference_update(self._keep(arrived))
        finally:
            pool.drop()

    def _progress_is_due(self) -> bool:
        """Return whether progress is to be reported. Raises Abandoned if the batch is given up."""
        if self._abandoned:
            raise Abandoned
        now = time.monotonic()
        due = now - self._told_at >= _TELL
        self._told_at = now if due else self._told_at
        return due

    def _keep(self, arrived: Sequence[tuple[Theta, Result]]) -> list[bytes]:
        """Keep the KPIs of θ with their results, and return the keys of these θ."""
        if not arrived:
            return []
        keys = theta_keys(np.array([theta for theta, _ in arrived], dtype=float))
        known = all_screened(self.scenario, [result for _, result in arrived])
        self._known.update(zip(keys, known, strict=True))
        nominal = self._is_nominal(keys[0])
        if nominal:
            self.count += len(keys)
            self.failed += sum(map(not_, known))
        else:
            self._times.arrived(len(keys), time.monotonic())
            self.varied = self.varied[0] + len(keys), self.varied[1]
        for (theta, result), kpis in zip(arrived, known, strict=True):
            again = False
            if isinstance(result, FailedRun):
                if nominal:
                    self.failure = f"{theta_text(self.scenario.space, theta)}: {result.words}"
                # A run that took too long, or whose process ended, may succeed another time.
                again = result.why != "raised"
            if self._kept is not None and not again:
                self._kept.add(theta, kpis)
        return keys
