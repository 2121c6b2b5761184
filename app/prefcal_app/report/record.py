"""A study as its report tells it: its record, its tables, and who may write to its folder."""

import csv
import inspect
import io
import json
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from itertools import count
from math import inf
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_app.session.study import ENOUGH
from prefcal_app.summary import VERDICTS as VERDICTS
from prefcal_app.summary import Outlook, Spread
from prefcal_app.view.end import FIRST, gain_view, gained, pid_rows, tell_noise
from prefcal_app.view.question import cell, column, judged, row, table, theta_texts, theta_view
from prefcal_env.controllers.forms import ANTI_WINDUP, BOTH, SERIES, PIDParameter
from prefcal_env.controllers.margins import Margins
from prefcal_env.controllers.stored import kind_of
from prefcal_env.errors import PrefcalError, SettingsError, StaleError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import named
from prefcal_env.knobs import theta_key
from prefcal_env.preferences.answer import Comparison, Preference
from prefcal_env.sources.source import plant_of
from prefcal_env.study import StudyFile, space_of, study_path, to_text
from prefcal_env.wording import in_words, locate
from prefcal_scenarios.names import is_described, is_own
from prefcal_scenarios.own import file_in, split_source
from prefcal_scenarios.runs import WORST, grouped
from prefcal_scenarios.scenario import KPI, Scenario
from prefcal_scenarios.verification.nominal import (
    UNKNOWN,
    Nominal,
    Redrawn,
    compare_draws,
    list_margins,
    margins_said,
    nominal_apart,
    nominal_of,
)
from prefcal_scenarios.wording import (
    MISSING,
    ended_text,
    exact_number,
    folder_for,
    labeled,
    marks_text,
    number,
    objective,
    with_unit,
)

# --- Reserve a folder for each study, so that a report never replaces another study's.

MARKER = "study.json"
"""Name of the file in a report's folder that identifies the study."""
_REPORT = ("report.html", "best.json", "comparisons.csv")


@dataclass(frozen=True, slots=True)
class Owner:
    """Study that a report belongs to."""

    identity: str  # text that is equal only for the same study
    study: str | None  # name of the study; None if it is not kept in a file
    scenario: str  # scenario of the study, as on the command line


@dataclass(frozen=True, slots=True)
class Ownership:
    """Folder that is reserved for a study."""

    folder: Path  # folder of the report
    owner: Owner  # study that owns it
    marked: bool  # whether this run wrote the marker file, rather than an earlier one
    made: bool  # whether this run created the folder

    def renew(self) -> None:
        """Write the marker again, in case another run of this study removed it."""
        _claim(self.folder, self.owner)

    def release(self) -> None:
        """Remove the marker and the folder if they are new, since there is no report."""
        if not self.marked or (self.folder / "report.html").exists():
            return
        try:
            (self.folder / MARKER).unlink(missing_ok=True)
            if self.made:
                self.folder.rmdir()
        except OSError:
            pass  # keep a folder to which other files were added


def claim_given(path: Path, owner: Owner) -> Ownership:
    """Claim the folder that the user named; it may exist.

    Raises:
        SettingsError: If it is not a folder, cannot be written to, or holds another report.
    """
    claim = _claim(path, owner)
    if claim is None:
        raise SettingsError(f"--out {path} holds {_holder(path)}: choose another folder, or remove that one")
    return claim


def claim_default(base: Path, owner: Owner) -> Ownership:
    """Claim the first of `base`, base-2, base-3, ... that is free or belongs to the study.

    Raises:
        SettingsError: If none can be created or written to.
    """
    paths = (base if copy == 1 else base.with_name(f"{base.name}-{copy}") for copy in count(1))
    folders = (path for path in paths if path.is_dir() or not path.exists())
    return next(claim for path in folders if (claim := _claim(path, owner)))


def _claim(path: Path, owner: Owner) -> Ownership | None:
    """Return the claim; None if the folder belongs to another study."""
    there = path.is_dir()
    folder = folder_for(path)
    marker = folder / MARKER
    if not marker.exists() and any((folder / name).exists() for name in _REPORT):
        return None
    try:
        # Exclusive creation: of two studies that try at the same time, one succeeds.
        with marker.open("x", encoding="utf-8") as file:
            json.dump(asdict(owner), file, indent=2, ensure_ascii=False)
            file.write("\n")
    except FileExistsError:
        mine = _read(marker).get("identity") == owner.identity
        return Ownership(folder, owner, marked=False, made=False) if mine else None
    except OSError as error:
        raise SettingsError(f"cannot write into the folder {path}: {error.strerror}") from error
    return Ownership(folder, owner, marked=True, made=not there)


def _holder(folder: Path) -> str:
    content = _read(folder / MARKER)
    if not content:
        return "a report whose study is not known"
    name = content.get("study")
    of = f"study {name!r}" if name else f"another study of {content.get('scenario')}"
    return f"the report of {of}"


def _read(marker: Path) -> dict[str, object]:
    """Return the content of a marker; empty if it cannot be read."""
    try:
        content = json.loads(marker.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def identity_of(file: StudyFile) -> str:
    """Return a text that is equal for two studies only if they are the same study.

    A file is identified by its configuration and its start time, so a copy is the same study. A
    study in memory is identified by its configuration alone, since the same command reproduces it
    bit for bit.
    """
    first = next(iter(file.events()))
    at = "" if file.path == ":memory:" else first.at
    return sha256(f"{at}\n{to_text(first.event)}".encode()).hexdigest()[:16]


def written_as(content: Mapping[str, Any]) -> str:
    """Return a fingerprint of θ and settings in a best.json, in 16 hexadecimal digits.

    Other programs write 2.0 as 2, −0.0 as 0, or keys in another order: that changes nothing of it.
    """
    said = json.dumps([content["theta"], content["settings"]])
    same = json.loads(said, parse_int=_unsigned, parse_float=_unsigned)
    return sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()[:16]


def _unsigned(text: str) -> float:
    return float(text) + 0.0  # no −0


def refuse_changed(best: Path, content: Mapping[str, Any]) -> None:
    """Raise a StaleError if θ or the settings in the content of a best.json are not those written."""
    if content.get("written as", written := written_as(content)) != written:
        owner = _read(best.parent / MARKER)
        name = owner.get("study") or (content.get("origin") or {}).get("study")
        how = f": {_anew(best, str(name), bool(owner))}" if name else ""
        raise StaleError(
            f"{str(best)!r} was changed by hand: theta and settings are not those of experiment "
            f"{content.get('experiment')} any more. Write it anew{how}"
        )


def refuse_outdated(best: Path, content: Mapping[str, Any]) -> None:
    """Refuse a best.json that is not the best of its study any more, or was changed by hand.

    The study itself says which one that is. One that is not here, or cannot be read, says nothing.

    Args:
        best: The file, in the folder of a report or copied from there.
        content: What is in it.

    Raises:
        StaleError: If the best of the study is another one, or θ or the settings are not those written.
    """
    refuse_changed(best, content)
    owner, above = _read(best.parent / MARKER), best.resolve().parent
    name = owner.get("study") or content.get("origin", {}).get("study")
    with suppress(StudyError, StopIteration):
        places = (place / study_path(str(name)) for place in (Path(), above, *above.parents))
        path = next(place for place in places if name and place.is_file())
        with StudyFile.open(path, clock=str, reading=True) as file:
            theta = np.array(_in_order(file, content["theta"]))
            if identity_of(file) != owner.get("identity") if owner else file.find_experiment(theta) is None:
                return  # another study of this name
            index, held = file.state.history.incumbent, content.get("experiment")
            if index is None or not _is_experiment(file, index, content):
                now = "nothing" if index is None else f"experiment {index + 1}"
                other = ", with other values of the knobs" if now == f"experiment {held}" else ""
                raise StaleError(
                    f"{str(best)!r} is not the best of its study any more: it holds experiment {held}{other}"
                    f", and the best of {name} is {now}. Write it anew: {_anew(best, str(name), bool(owner))}"
                )


def _anew(best: Path, name: str, in_report: bool) -> str:
    """Return the command that writes a best.json anew, in the folder of its report if it is in one."""
    words, folder = ["prefcal", "report", name], best.parent
    if in_report and folder.resolve() != Path(f"prefcal-{study_path(name).stem}").resolve():
        words += ["--out", str(folder)]
    return shlex.join(words)


def _is_experiment(file: StudyFile, index: int, content: Mapping[str, Any]) -> bool:
    """Return whether a best.json holds this experiment of a study; a plant may have rounded its θ."""
    theta, ran = file.state.history.samples[index].theta, file.experiment(file.state.finished[index]).theta
    now = ran.tolist() if len(ran) == len(theta) else list(theta)  # knobs were added since it ran
    return content.get("experiment") == index + 1 and _in_order(file, content["theta"]) == now


def _in_order(file: StudyFile, theta: Mapping[str, Any]) -> list[Any]:
    """Return the values of θ in the order of a study's knobs; names that it does not know come last."""
    order = {name: k for k, name in enumerate(space_of(file.state.configuration).names)}
    return [theta[name] for name in sorted(theta, key=lambda name: order.get(name, len(order)))]


# --- Hold the content of a report: a study's comparisons, and what follows from them.

Surrogate = Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]]
"""Learned latent cost of m physical θ; lower is better, only the order has a meaning."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Experiment number `index`, from 0, and its cost; None if the scenario has no cost."""

    index: int
    experiment: Experiment
    cost: float | None

    @property
    def number(self) -> int:
        """Return the number as people count, from 1."""
        return self.index + 1


@dataclass(frozen=True)
class StudyRecord:
    """Study, complete or not, ready to be shown.

    Args:
        scenario: Calibrated scenario.
        source: Name that loads the scenario again.
        comparisons: Comparisons in the order of the answers.
        held: Index of the best experiment after each of `comparisons`; see `History.incumbents`.
        references: Experiments of the scenario's reference θ, by name.
        settings: Settings that the study was started with, by name, for people.
        agent_settings: All settings of the agent, by name.
        n_init: Number of experiments before anything was learned.
        n_max: Number of planned experiments.
        command: Command line that repeats the study.
        anew: Command line that begins another such study.
        surrogate: Learned cost; None if the agent learns nothing.
        trust: How well a weighted sum of the KPIs predicts answers; empty if unknown.
        ended: Why the study ended, see `prefcal_env.study.Ended`; empty while it has not.
        answered: Comparisons whose answers stand, in order, including follow-up comparisons; None
            for all of `comparisons` but the first experiment's.
        waiting: Experiments that ran and are not compared yet, by index.
        judged: Whether the answers follow the scenario's cost; otherwise, the cost is not shown.
        outlook: Whether to continue; None if unknown.
        study: Name of the study; empty if it is not kept.
        dates: Times of the study's first and last event.
        baseline: What the first experiment is, with which the result is compared; see `baseline_of`.
        fingerprint: Fingerprint of the scenario's files; empty if unknown.
        digest: SHA-256 of the study file, in hexadecimal digits; empty if there is none.
        by: Name of the person who answered; empty if it was not given.
        kept: What was confirmed on the plant, as `kept_on_plant` returns it; empty if nothing was.
        robust: How the result of a robust study holds, a sentence each; empty for other studies.
        runs_held: In how many varied runs of that the first experiment and the result hold; None if unknown.
    """

    scenario: Scenario
    source: str
    comparisons: tuple[Comparison, ...]
    held: tuple[int, ...]
    references: Mapping[str, Experiment] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    agent_settings: Mapping[str, Any] = field(default_factory=dict)
    n_init: int = 10
    n_max: int = 50
    command: str = ""
    anew: str = ""
    surrogate: Surrogate | None = None
    trust: str = ""
    ended: str = ""
    answered: tuple[Comparison, ...] | None = None
    waiting: Mapping[int, Experiment] = field(default_factory=dict)
    judged: bool = True
    outlook: Outlook | None = None
    study: str = ""
    dates: tuple[str, ...] = ()
    baseline: str = FIRST
    fingerprint: str = ""
    digest: str = ""
    by: str = ""
    kept: Mapping[str, Any] = field(default_factory=dict)
    robust: tuple[str, ...] = ()
    runs_held: tuple[int, int] | None = None

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Return every experiment once, in the order tried."""
        experiments: dict[int, Experiment] = dict(self.waiting)
        for c in self.comparisons:
            if c.query.incumbent is not None and c.incumbent is not None:
                experiments.setdefault(c.query.incumbent.index, c.incumbent)
            experiments.setdefault(c.query.challenger.index, c.challenger)
        return tuple(Trial(i, e, self.cost(e)) for i, e in sorted(experiments.items()))

    def costed(self) -> tuple["StudyRecord", str]:
        """Return this record, without costs if the scenario's fails, and then how it failed."""
        try:
            self.trials, self.reference_costs  # noqa: B018  # both compute all costs
            if trouble := getattr(self.scenario.cost, "trouble", None):
                raise trouble
        except Exception as error:  # the user's code can raise anything
            scenario = replace(self.scenario, cost=None)
            return replace(self, scenario=scenario), in_words(locate(error))
        return self, ""

    @property
    def before(self) -> Trial:
        """Return the first trial, with which the result is compared."""
        return self.trials[0]

    @property
    def _uncosted(self) -> str:
        """Return which experiments failed since their cost is unknown, and why; empty for none."""
        why: dict[bytes, str] = getattr(self.scenario.cost, "unknown", {})
        failed = {t.number: why.get(theta_key(t.experiment.theta), "") for t in self.trials}
        numbers = [str(number) for number, words in failed.items() if words]
        words = next((words for words in failed.values() if words), "")
        return f"experiments {', '.join(numbers)}: {words}" if numbers else ""

    @property
    def origin(self) -> dict[str, str]:
        """Return who answered, when, and for what scenario, by label.

        A study that a program can repeat has no dates, so that it gives equal reports.
        """
        program = f"a simulated person ({self.settings.get('calibrator', 'a program')})"
        by = self.by or "a person" if self.by_a_person else program
        minutes = [at[:16].replace("T", " ") for at in self.dates if self.by_a_person]
        when = " to ".join(dict.fromkeys(minutes))
        found = {
            "study": self.study,
            "answered by": "" if self.scored else by,
            "when (UTC)": when,
            "fingerprint of the scenario": self.fingerprint,
            "failed, as their cost is unknown": self._uncosted,
        }
        return {label: text for label, text in found.items() if text}

    @cached_property
    def thetas(self) -> Float[np.ndarray, "N n"]:
        """Return the θ of every trial, physical, shape (N, n)."""
        return np.array([t.experiment.theta for t in self.trials]).reshape(-1, len(self.scenario.space))

    @property
    def margins(self) -> tuple[Margins | str, ...]:
        """Return the margins of the result and of the tuning before, or why there are none."""
        return self._nominal[0]

    @cached_property
    def noise(self) -> Redrawn | str:
        """Return what KPIs are with other draws of the sensor noise, or why that is not known."""
        own, (_, drawn, lacking) = [each.experiment for each in self._both], self._nominal
        if isinstance(drawn, str):
            return drawn
        unit = own[0].channels.time_unit
        return compare_draws(self.kpis, own, drawn, unit, lacking) if drawn else Redrawn()

    @property
    def _both(self) -> list[Trial]:
        """Return the result and the tuning before; only that if it is the result."""
        return [self.result, self.before][: 1 + (self.result.index != self.before.index)]

    @cached_property
    def _nominal(self) -> Nominal:
        """Return what is known of each of `_both` on the nominal plant."""
        source, seed = self.scenario.source, self.settings.get("seed", 0)
        thetas = [each.experiment.theta for each in self._both]
        with suppress(PrefcalError):
            return nominal_of(source, thetas, seed)
        if plant_of(source) is None:
            return (UNKNOWN,), [], ""
        try:  # a file that runs in a process of its own
            return nominal_apart(source, thetas, seed)
        except PrefcalError as error:
            return (f"no margins: {error}",), [], ""

    @property
    def margin_words(self) -> tuple[str, ...]:
        """Return the margins, with those before in brackets, a text each; empty if there are none."""
        rows, _ = margins_said(self.margins, self.before.experiment.channels.time_unit)
        return list_margins(rows)

    @property
    def asked(self) -> tuple[Comparison, ...]:
        """Return the comparisons whose answers stand, in the order given."""
        if self.answered is not None:
            return self.answered
        return tuple(c for c in self.comparisons if c.incumbent is not None)

    @property
    def questions(self) -> int:
        """Return the number of questions that the calibrator answered."""
        return 0 if self.scored else len(self.asked)

    @property
    def by_a_person(self) -> bool:
        """Return whether a person compared."""
        return self.settings.get("calibrator") == "human"

    @property
    def shows_cost(self) -> bool:
        """Return whether to show the cost: there is one, and the answers follow it."""
        return self.scenario.cost is not None and self.judged

    @property
    def scored(self) -> bool:
        """Return whether the agent learned from scores, without comparisons."""
        return any(c.answer.value is not None for c in self.comparisons)

    @property
    def stopped(self) -> bool:
        """Return whether the study ended before its planned number of experiments, with more to gain."""
        return self.is_shorter and self.ended != ENOUGH

    @property
    def partial(self) -> bool:
        """Return whether the study was left before its end, which nobody and nothing ended."""
        return self.is_shorter and not self.ended

    @property
    def reached(self) -> str:
        """Return how many experiments ran, and how many of them wait for their answer, in words."""
        compared = {c.query.challenger.index for c in self.comparisons}
        waiting = sum(trial.index not in compared for trial in self.trials)
        left = f", {'one' if waiting == 1 else waiting} of them not compared" if waiting else ""
        return f"{len(self.trials)} of {self.n_max} experiments{left}"

    @property
    def is_shorter(self) -> bool:
        """Return whether fewer experiments were compared than planned at most."""
        return len(self.comparisons) < self.n_max

    @cached_property
    def best(self) -> Trial | None:
        """Return the best experiment; None before the first."""
        return self.incumbents[-1] if self.comparisons else None

    @property
    def result(self) -> Trial:
        """Return the best experiment of a study that has one."""
        assert self.best is not None
        return self.best

    @cached_property
    def incumbents(self) -> tuple[Trial, ...]:
        """Return the best trial after each comparison."""
        by_index = {t.index: t for t in self.trials}
        return tuple(by_index[index] for index in self.held)

    @cached_property
    def reference_costs(self) -> dict[str, float]:
        """Return the cost of each reference; empty if the scenario has no cost."""
        costs = {name: self.cost(e) for name, e in self.references.items()}
        return {name: cost for name, cost in costs.items() if cost is not None}

    @cached_property
    def compared_with(self) -> dict[str, Experiment]:
        """Return the baseline, then the references; equal θ once, under all of their names."""
        runs = {self.baseline: self.before.experiment}
        runs |= {name: e for name, e in self.references.items() if name not in runs}
        names: dict[tuple[float, ...], list[str]] = {}
        for name, experiment in runs.items():
            names.setdefault(tuple(experiment.theta.tolist()), []).append(name)
        return {" and ".join(same): runs[same[0]] for same in names.values()}

    @property
    def kpis(self) -> tuple[KPI, ...]:
        """Return the scenario's KPIs without the index itself, which is shown as the cost."""
        return self.scenario.shown_kpis

    def read(self, kpi: KPI) -> Float[np.ndarray, " N"]:
        """Return the KPI of every trial as people read it; NaN where it is unknown."""
        return np.array([kpi.read(t.experiment.kpis.get(kpi.name, np.nan)) for t in self.trials])

    def cost(self, experiment: Experiment) -> float | None:
        """Return the latent cost of an experiment; None if the scenario has none.

        It is infinite for a run without a record.
        """
        if self.scenario.cost is None:
            return None
        return float(self.scenario.cost(experiment)) if len(experiment.t) else inf

    def verdict_counts(self) -> dict[str, int]:
        """Return the number of answers for each verdict, by its text."""
        given = [c.answer.preference for c in self.asked]
        return {words: given.count(verdict) for verdict, words in VERDICTS.items()}


# --- List the tables of the report: the result, every experiment, and every comparison, also as CSV.

_T = TypeVar("_T")
MOST = 3  # number of KPIs that the table of experiments shows


def gain_rows(record: StudyRecord) -> list[dict[str, Any]]:
    """Return what was gained, a row for each KPI, as the page shows it."""
    spread = Spread(trial.experiment.kpis for trial in record.trials)
    both = record.before.experiment, record.result.experiment
    return gained(*both, record.kpis, spread, record.runs_held, noise=record.noise)


def gain_of(record: StudyRecord) -> dict[str, Any]:
    """Return what was gained over the baseline, as the page shows it."""
    before, rows = theta_view(record.scenario.space, record.before.experiment, exact=True), gain_rows(record)
    view = gain_view(record.baseline, record.result.index, rows, before)
    return {**view, "noise": tell_noise(rows, record.noise)}


def foremost(ranked: Sequence[_T], room: int, has_limit: Callable[[_T], bool]) -> list[_T]:
    """Return as many rows as fit; those with an objective are the last ones to be left out."""
    order = sorted(range(len(ranked)), key=lambda i: (not has_limit(ranked[i]), i))
    return [ranked[i] for i in sorted(order[:room])]


def foremost_kpis(record: StudyRecord, room: int) -> list[KPI]:
    """Return the KPIs that tell experiments apart, in the order of what was gained.

    Values that read the same are no difference. A KPI that is the same in all experiments tells
    something only if it misses its objective.
    """
    order = [row["title"] for row in gain_rows(record)]
    ranked = sorted(record.kpis, key=lambda kpi: order.index(kpi.title))

    def tells(kpi: KPI) -> bool:
        values = np.unique(record.read(kpi))
        known = values[~np.isnan(values)]
        return len(known) > 1 or any(kpi.met(value) is False for value in known)

    return foremost(list(filter(tells, ranked)), room, lambda k: bool(objective(k)))


def pid_forms_of(record: StudyRecord) -> list[tuple[PIDParameter, str, str]]:
    """Return each parameter of a tuned PID in each form, with its best value and that before.

    Empty for other controllers.
    """
    scenario = record.scenario
    if scenario.settings is None or record.best is None:
        return []
    best, before = record.best.experiment, record.before.experiment
    new, old = (scenario.settings(each.theta) for each in (best, before))
    return pid_rows(scenario.space, new, old, best.channels.time_unit)


def pid_text(record: StudyRecord) -> str:
    """Return the forms of a tuned PID, and what of it was not tuned; empty for other controllers."""
    # Not what only the PID before has.
    parts = [p for p, new, _ in pid_forms_of(record) if new != MISSING or p.form == SERIES]
    if not parts:
        return ""
    fixed = [
        p for p in parts if not p.derived and p.name.partition(" ")[0] not in record.scenario.space.names
    ]
    rest, series = (
        ", ".join(f"{p.name} {with_unit(number(p.value), p.unit)}" for p in some)
        for some in (fixed, [p for p in parts if p.form == SERIES and p.value == p.value])
    )
    gains = [p for p in parts if p.form == BOTH and p.name.startswith("K_p")]
    actions = [f"reverse ({p.name} > 0)" if p.value > 0 else f"direct ({p.name} < 0)" for p in gains]
    return (
        "ISA form: K_p (b r − y + 1/T_i ∫(r − y) dt + T_d d(c r − y)/dt), derivative filtered with T_f. "
        f"Parallel form: K_i and K_d in place of K_p/T_i and K_p T_d. Series form: {series or 'none'}. "
        f"{ANTI_WINDUP} Action: {', '.join(actions)}.{f' Not tuned: {rest}.' if rest else ''}"
    )


def controller_text(record: StudyRecord) -> str:
    """Return which controller is tuned, and where it is; empty of a PID with forms, and if nobody knows."""
    scenario, source = record.scenario, record.scenario.source
    settings = {} if scenario.settings is None else scenario.settings(record.result.experiment.theta)
    if pid_forms_of(record) or source.asks:
        return ""
    if kind_of(kind := settings.get("controller")) and "model" in (settings.get("lqr") or settings):
        return f"{kind}{_name_period(record)}; complete in best.json."
    if not is_own(record.source) or is_described(record.source):
        return ""
    made = scenario.controller or source.controller
    made, path = getattr(made, "func", made), file_in(split_source(record.source)[0])[0]  # func of a partial
    with suppress(TypeError, OSError):  # of a callable object there is no source
        path = Path((made and inspect.getsourcefile(made)) or path or "")
    name = getattr(made, "__qualname__", "<")
    which = "" if "<" in name else f", {'class' if inspect.isclass(made) else 'function'} {name}"
    where = f" in {path.name}{which}" if path else which
    kept = "only its settings are" if settings else "not"
    return f"Code{where}{_name_period(record)}; form and action as written there; {kept} in best.json."


def _name_period(record: StudyRecord) -> str:
    """Return how often the result moves, after other words; "" if that differs."""
    e = record.result.experiment
    periods = np.diff(e.t_control)
    if not len(periods) or not np.allclose(periods, periods[0]):
        return ""
    return f", sampled every {with_unit(number(float(f'{periods[0]:.6g}')), e.channels.time_unit)}"


def result_columns(record: StudyRecord) -> dict[str, Experiment]:
    """Return the experiments of the result table by heading: best, baseline, references."""
    return {"best": record.result.experiment, **record.compared_with}


def result_rows(record: StudyRecord, experiments: Iterable[Experiment]) -> Iterator[dict[str, Any]]:
    """Yield a row for each knob, the cost, each KPI, and how these experiments ended."""
    shown = list(experiments)
    for i, knob in enumerate(record.scenario.space):
        yield row(knob.name, [cell(exact_number(float(e.theta[i]))) for e in shown], unit=knob.unit)
    if record.shows_cost:
        yield row("performance index", [cell(number(record.cost(e))) for e in shown])
    for part, kpi in _grouped(record.kpis, shown):
        title = kpi.title if part in ("", WORST) else named(kpi.title, part)
        yield row(title, [judged(kpi, e) for e in shown], unit=kpi.unit, aim=objective(kpi))
    yield row("ended", [cell(ended_text(e)) for e in shown])


def _grouped(kpis: Sequence[KPI], shown: Sequence[Experiment]) -> Sequence[tuple[str, KPI]]:
    """Return KPIs by group; without maneuvers all of them, even those that no experiment has."""
    if not any(run.maneuver for e in shown for run in e.runs):
        return [("", kpi) for kpi in kpis]
    return grouped(kpis, *shown)


def result_table(record: StudyRecord) -> dict[str, Any]:
    """Return the best experiment beside the baseline and the references."""
    columns = result_columns(record)
    rows = list(result_rows(record, columns.values()))
    for each in rows:
        each["cells"][0]["kind"] = "best"
    return table("Result table", ("", *columns), rows, "✓ meets the objective, ✗ does not.")


def experiment_table(record: StudyRecord) -> dict[str, Any]:
    """Return every experiment with θ and the main KPIs, in the order of their numbers."""
    kpis = foremost_kpis(record, MOST)
    rows = []
    for trial in record.trials:
        kind = "best" if trial.index == record.result.index else ""
        theta = theta_texts(record.scenario.space, trial.experiment.theta)
        cells = [cell(text, kind=kind) for text in theta]
        cells += [judged(kpi, trial.experiment, kind) for kpi in kpis]
        cells.append(cell(ended_text(trial.experiment), kind=f"words {kind}".strip()))
        rows.append(row(str(trial.number), cells, kind=kind))
    knobs = [column(k.name, k.unit) for k in record.scenario.space]
    columns: list[dict[str, Any] | str] = [
        "exp.",
        *knobs,
        *(column(k.title, k.unit) for k in kpis),
        column("ended", kind="words"),
    ]
    caption = "The tinted experiment is the best. ✓ meets the objective, ✗ does not."
    return table("Experiments", columns, rows, caption, "tight")


def comparison_table(record: StudyRecord) -> dict[str, Any]:
    """Return every question with its answer, in the order of the answers."""
    rows = [row(str(k), list(_answered(comparison))) for k, comparison in enumerate(record.asked, start=1)]
    words = [column(name, kind="words") for name in ("verdict", "marks")]
    columns: list[dict[str, Any] | str] = ["no.", *words, "newer experiment", "compared with"]
    caption = (
        "The tinted experiment was preferred; its values are under Experiments. All KPIs and full "
        "precision are in comparisons.csv."
    )
    return table("Comparisons", columns, rows, caption, "tight")


def _answered(comparison: Comparison) -> Iterator[dict[str, Any]]:
    query, answer = comparison.query, comparison.answer
    assert query.incumbent is not None
    yield cell(VERDICTS[answer.preference], kind="words")
    yield cell("; ".join(marks_text(answer)), kind="words")
    for sample, wins in ((query.challenger, Preference.CHALLENGER), (query.incumbent, Preference.INCUMBENT)):
        yield cell(str(sample.index + 1), kind="best" if answer.preference is wins else "")


def comparisons_as_csv(record: StudyRecord) -> str:
    """Return the text of comparisons.csv."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_headings(record))
    for k, comparison in enumerate(record.asked, start=1):
        writer.writerow([k, *_cells(record, comparison)])
    return text.getvalue()


def _headings(record: StudyRecord) -> Iterator[str]:
    yield from ("comparison", "verdict", "preference", "strength", "marks", "automatic marks")
    scenario = record.scenario
    for side in ("challenger", "incumbent"):
        yield f"{side} experiment"
        yield from (f"{side} {labeled(k.name, k.unit)}" for k in scenario.space)
        yield from (f"{side} {labeled(k.title, k.unit)}" for k in record.kpis)
        yield from (f"{side} cost", f"{side} ended")


def _cells(record: StudyRecord, comparison: Comparison) -> Iterator[object]:
    answer, query = comparison.answer, comparison.query
    yield VERDICTS[answer.preference]
    yield "" if answer.preference is None else int(answer.preference)
    yield answer.strength
    yield ", ".join(mark.value for mark in answer.marks)
    yield ", ".join(mark.value for mark in answer.automatic)
    assert query.incumbent is not None
    assert comparison.incumbent is not None
    yield query.challenger.index + 1
    yield from _side(record, comparison.challenger)
    yield query.incumbent.index + 1
    yield from _side(record, comparison.incumbent)


def _side(record: StudyRecord, experiment: Experiment) -> Iterator[object]:
    scenario = record.scenario
    yield from scenario.space.named(experiment.theta).values()
    yield from (experiment.kpis.get(k.name, "") for k in record.kpis)
    cost = record.cost(experiment)
    yield "" if cost is None else cost
    yield ended_text(experiment)
