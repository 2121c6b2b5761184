"""Ask inside a notebook: the page of a study in a frame below the cell, and the study in Python.

The study runs beside the notebook, whose cells stay free.
"""

import threading
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float
from jinja2 import Environment
from rich.console import Console

from prefcal_agents.screening.agent import Certificate
from prefcal_app.cli.calibrate import SAID_SOON, calibration
from prefcal_app.cli.choices import make_calibrator, open_study
from prefcal_app.cli.options import Options
from prefcal_app.report.export import load_controller
from prefcal_app.session import Background, Phase, unattended
from prefcal_app.web import Window
from prefcal_env.errors import SettingsError, StudyError
from prefcal_env.experiments.experiment import Controller
from prefcal_env.study import State, study_path
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.scenario import Scenario

_OWN = ("scenario", "study", "out")  # options of `prefcal calibrate` that `ask` takes itself
_NOT_HERE = {"terminal", "browser", "json", "host", "config", "plant", "twin", "cost", "at_once"}
"""Options of `prefcal calibrate` that mean nothing in a notebook, or are Python objects there."""
_PATIENCE = 0.5  # longest wait for the next change, in seconds
_LAST_RUN = 5.0  # longest wait for a run that cannot be ended, or for the report, in `close`, in seconds
_OPEN: dict[Path, "Asking"] = {}
"""Studies that this process asks about, by file: a cell that runs again closes the earlier one."""

_HTML = """
<div id="{{ name }}"><p><a href="{{ link }}" target="_blank" rel="noopener">Open the questions in a
tab of their own</a></p></div>
<script>
(() => {
  const place = document.getElementById({{ name | tojson }});
  const link = new URL({{ link | tojson }});
  const here = location.hostname;
  if (!place || location.protocol !== "http:" || !["127.0.0.1", "localhost"].includes(here)) return;
  link.hostname = here;  // the cookie of another name would not be sent
  const frame = document.createElement("iframe");
  Object.assign(frame, { src: link.href, title: "prefcal: which of two runs is better?" });
  Object.assign(frame.style, { width: "100%", height: {{ height | tojson }}, border: "0" });
  place.append(frame);
})();
</script>
"""


def ask(
    scenario: Scenario | str,
    *,
    study: str | None = None,
    out: Path | str | None = None,
    height: int = 760,
    **options: Any,
) -> "Asking":
    """Start or resume a study whose questions appear below the cell; return at once.

    The page is that of `prefcal calibrate`, so every answer is saved at once, and the same `study`
    resumes. With `calibrator="synthetic"`, or another one of the scenario, no person is needed.

    Args:
        scenario: A scenario, or its name as in `prefcal calibrate`.
        study: Name or file of the study; None for a new one.
        out: Folder of the report; None for the default.
        height: Height of the frame in pixels.
        options: Further options of `prefcal calibrate`, with underscores: `n_max=20, seed=1`.

    Raises:
        SettingsError: If there is no such option, or its value does not fit.
        StudyError: If the study cannot be opened, or belongs to another scenario.
    """
    if study is not None and (earlier := _OPEN.get(study_path(study).resolve())) is not None:
        earlier.close()
    given = _given(options)
    own, name = (scenario, scenario.name) if isinstance(scenario, Scenario) else (None, scenario)
    given |= {"scenario": name} | ({} if study is None else {"study": study})
    return Asking(own, given if out is None else {**given, "out": Path(out)}, height)


def _given(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of `prefcal calibrate` that are given; None stands for the default."""
    names = [f.name for f in fields(Options) if f.name not in {*_OWN, *_NOT_HERE}]
    unknown = [name for name in options if name not in names]
    if unknown:
        raise SettingsError(f"ask has no option {unknown[0]!r}: expected one of {names}")
    start = options.get("start")
    several = {"start": (start,)} if isinstance(start, str) else {}
    return {name: value for name, value in {**options, **several}.items() if value is not None}


class Asking:
    """A study that runs beside the notebook. Make one with `ask`.

    A notebook shows it as the page with its questions. `with` closes it at the end.
    """

    def __init__(self, scenario: Scenario | None, given: Mapping[str, Any], height: int) -> None:
        self._height = height
        self._problem: Exception | None = None
        self._reported: State | None = None  # the end of the study that its report shows
        self._closed = False
        self._changed = threading.Condition()
        made_here = scenario is not None
        with ExitStack() as stack:
            if scenario is None:
                source, limit = given["scenario"], Options.of(given).run_timeout
                scenario = stack.enter_context(isolation(source, limit))(load(source))
            file, options, resumed = open_study(given, scenario)
            stack.enter_context(file)
            # Of a scenario that was made here, the file of the study does not know the code.
            quiet, keep = Console(quiet=True), not made_here
            work = calibration(file, options, scenario, quiet, resumed=resumed, keep=keep)
            self._work = stack.enter_context(work)
            self._interview = self._work.interview
            self._calibrator = None if options.by_a_person else make_calibrator(options, scenario)
            self._person = options.by_a_person
            window = Window(self._interview, port=options.port, framed=True)
            self._window = stack.enter_context(window)
            if options.study is not None:
                path = Path(file.path).resolve()
                _OPEN[path] = self
                stack.callback(_OPEN.pop, path, None)
            if self._person:
                stack.enter_context(Background(self._interview))
            watch = threading.Thread(target=self._watch, name="report", daemon=True)
            stack.callback(watch.join, _LAST_RUN)
            stack.callback(self._interview.close)
            stack.callback(self._stop)
            watch.start()
            self._stack = stack.pop_all()

    def _stop(self) -> None:
        """Wake `wait`: nothing is asked any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _watch(self) -> None:
        try:
            while not self._closed:
                if not self._person:
                    for _ in unattended(self._interview, self._calibrator):
                        if self._closed:
                            return
                now = self._interview.now()
                # A finished study can go on, or lose its last answer, and end anew; and what is said of
                # its result comes later than the end.
                if now.phase is Phase.OVER and now.state is not self._reported:
                    self.report()
                    with self._changed:
                        self._reported = now.state
                        self._changed.notify_all()
                self._interview.wait(now.version, _PATIENCE)
        except Exception as error:  # raised by `wait`, in the notebook's own thread
            with self._changed:
                if not self._closed:  # else it only says that the study file is closed
                    self._problem = error
                self._changed.notify_all()

    @property
    def link(self) -> str:
        """Return the link of the page, which holds its secret."""
        return self._window.link

    @property
    def study(self) -> str | None:
        """Return the name of the study, as in `prefcal calibrate --study`; None if not kept."""
        return self._work.options.study

    @property
    def best(self) -> dict[str, float] | None:
        """Return the best θ so far by knob name; None before the first experiment."""
        names, theta = self._interview.scenario.space.names, self._best
        return None if theta is None else dict(zip(names, map(float, theta), strict=True))

    @property
    def _best(self) -> Float[np.ndarray, " n"] | None:
        now = self._interview.now()
        if now.incumbent is None:
            return None
        return np.array(now.state.history.samples[now.incumbent].theta)

    @property
    def certificate(self) -> Certificate | None:
        """Return what can be said of the best θ so far; None while nothing can.

        That is so before the second answer, while it is worked out, and for agents that simulate
        nothing.
        """
        found = self._interview.known.findings
        return None if found is None else found.certificate

    @property
    def chance_of_better(self) -> float | None:
        """Return the chance that the next experiment is noticeably better than the best so far.

        None before the fifth answer, where KPIs explain no answers, and for agents that simulate.
        """
        foresight = self._interview.known.foresight()
        return None if foresight is None else foresight.chance

    @property
    def over(self) -> bool:
        """Return whether the study is over and the report of this end, with all that is said, is written."""
        told, now = self._interview.known.is_told, self._interview.now()
        return told and now.phase is Phase.OVER and now.state is self._reported

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the study is over or closed, `timeout` seconds at most; return whether it is over.

        Raises:
            Exception: What a run or the report has raised.
        """
        with self._changed:
            self._changed.wait_for(lambda: self.over or self._closed or self._problem is not None, timeout)
        if self._problem is not None:
            raise self._problem
        return self.over

    def report(self) -> Path:
        """Write the report of the study as it stands; return its folder.

        Raises:
            StudyError: If no experiment is compared yet, or the folder cannot be written.
        """
        if not self._interview.file.state.history.answered:
            raise StudyError("nothing to report: no experiment was compared yet")
        self._interview.known.wait_for_findings(SAID_SOON)
        self._work.write()
        folder = self._work.claim.folder
        if not (folder / "report.html").is_file():
            raise StudyError("nothing to report: no question was answered yet")
        if self._interview.now().phase is Phase.OVER:
            self._window.reports = folder
        return folder

    def controller(self) -> Controller:
        """Return the controller tuned so far, by way of the report's best.json.

        Raises:
            StudyError: If no experiment is compared yet.
            ScenarioError: If the scenario does not say how to build a controller.
        """
        make, theta = self._interview.scenario.controller, self._best
        if make is not None and theta is not None:
            return make(self._interview.scenario.space.check(theta))
        return load_controller(self.report() / "best.json")

    def to_frame(self, *, answers: bool = False) -> Any:
        """Return the experiments, or the answers, as a pandas DataFrame."""
        return self._interview.file.to_frame(answers=answers)

    def close(self) -> None:
        """Stop asking, and wake `wait`. Answers are saved; `ask` with the same study resumes.

        A run inside the notebook's process that takes longer than 5 s ends later, unrecorded.
        """
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        # A frame works if the notebook's own page comes from localhost or 127.0.0.1: browsers keep the
        # page's cookie from frames on pages of other sites. Elsewhere the link remains.
        name = f"prefcal-{self.link.rpartition('/')[2][:12]}"
        template = Environment(autoescape=True).from_string(_HTML)
        return template.render(link=self.link, name=name, height=f"{self._height}px")

    def __repr__(self) -> str:
        counts, name = self._interview.known.counts, self.study or "not kept"
        return f"<study {name}: {counts.experiments} experiments, {counts.comparisons} answers>"
