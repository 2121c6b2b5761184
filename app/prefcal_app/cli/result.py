"""Record what a report says of a study, and print its result as a table or as JSON."""

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from prefcal_agents.registry import agent_class
from prefcal_app.report.record import StudyRecord, gain_of, result_table
from prefcal_app.session import Interview
from prefcal_app.session.study import trust_text
from prefcal_app.simulating import robust_study
from prefcal_app.summary import Outlook, kept_on_plant, kept_text, list_shown
from prefcal_app.terminal.showing import say
from prefcal_app.view.end import baseline_of, runs_held, tell_margins
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.study import Concluded, State
from prefcal_scenarios.own import fingerprint
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.verification.said import BEST
from prefcal_scenarios.wording import labeled, printable

from .choices import IN_MEMORY, follows_cost
from .options import Options
from .parameters import kept_by
from .studies.files import as_text


def record_of(interview: Interview, options: Options, references: Mapping[str, Experiment]) -> StudyRecord:
    """Return the record of the study as it stands, for reports."""
    with interview.past.still():
        now, events = interview.now(), interview.file.events()
        state = now.state
        comparisons, answered = interview.past.comparisons(), interview.past.answered()
        shown = {k: interview.past.experiment(k) for k in list_shown(state) if k >= state.history.answered}
    (then, today), agent = _fingerprints(options, state), state.configuration["agent"]
    winners = state.history.incumbents()  # after each closed query; the last is the best now
    # What prefcal says of the result comes when it is ready, which is nothing that anybody did.
    times = [each.at for each in events if not isinstance(each.event, Concluded)]
    return StudyRecord(
        scenario=interview.scenario,
        source=options.scenario,
        comparisons=comparisons,
        answered=answered,
        held=winners if now.incumbent is None else (*winners[:-1], now.incumbent),
        waiting=shown,
        references=references,
        settings=options.settings(),
        # The options name the study of the taste; its answers are in the file, not for people to read.
        agent_settings={f"{agent['agent']} {k}": v for k, v in agent["settings"].items() if k != "taste"},
        n_init=options.n_init,
        n_max=interview.known.n_max,
        command=options.command(),
        anew=options.anew(),
        surrogate=interview.known.surrogate,
        trust="" if (index := interview.known.index) is None else trust_text(index),
        ended=state.ended or "",
        outlook=_outlook(interview, options),
        judged=follows_cost(options, interview.scenario),
        study=options.study or "",
        dates=tuple(dict.fromkeys((times[0], times[-1]))),
        baseline=baseline_of(state),
        fingerprint=then if then == today else f"{then}; its files have changed since, now {today}",
        by=options.by or "",
        kept=kept_on_plant(state),
        robust=_robust(interview) if options.robust else (),
        runs_held=runs_held(interview.known.findings),
        digest=interview.file.digest if options.by_a_person and interview.file.path != IN_MEMORY else "",
    )


_MORE = 5  # questions that are offered at the end, where something better may be left


def _outlook(interview: Interview, options: Options) -> Outlook | None:
    """Return the outlook of a study with the command that asks a person more, if that promises something."""
    known, found = interview.known, interview.known.outlook
    kept = options.by_a_person and interview.file.path != IN_MEMORY
    listed = interview.scenario.source.candidates is not None  # all of these may have been shown
    if found is None or not (kept and interview.now().state.ended and known.worth_going_on) or listed:
        return found
    command = f"{options.again()} --n-max {known.n_max + _MORE}"
    return replace(found, more=f"To look for it with {_MORE} more questions, run: {command}")


def _robust(interview: Interview) -> tuple[str, ...]:
    known, best = interview.known, interview.now().incumbent
    counts = _count_held(interview)
    return robust_study(known.findings, interview.scenario, known.nominal(best), best=best, counts=counts)


def _count_held(interview: Interview) -> dict[int, int]:
    """Return how many perturbed runs the two experiments keep that were compared last, by index, if known."""
    latest, history = interview.known.screened(current=False), interview.now().state.history
    if latest is None or latest.pending is None or not history.comparisons:
        return {}
    last, reason = history.comparisons[-1], latest.findings.reason
    if reason is None or history.samples[last.challenger].theta != latest.pending.theta:
        return {}
    pairs = ((last.challenger, reason.kept), (last.incumbent, reason.against))
    return {index: count for index, count in pairs if index is not None and count is not None}


def _fingerprints(options: Options, state: State) -> tuple[str, str]:
    """Return the fingerprint of the scenario at the start, or now if that is not known, and now."""
    now = fingerprint(options.scenario)
    return str(state.configuration.get("fingerprint", now)), now


def changes(options: Options, state: State) -> Iterator[str]:
    """Yield what is no longer as it was when a study was begun, and what that means."""
    source, (then, now) = options.scenario, _fingerprints(options, state)
    if state.finished and then != now:
        yield (
            f"The files of {source} have changed since this study began: its {len(state.finished)} "
            "experiments ran with the old ones, and are compared with new ones. If that matters, begin anew "
            f"from what you know: prefcal calibrate {shlex.quote(source)} --start {options.study}:best"
        )
    agent = state.configuration["agent"]
    made, by = agent["version"], agent_class(agent["agent"]).version
    if state.history.samples and made != by:
        yield (
            f"This study was begun with version {made} of {agent['agent']}: earlier proposals were made by "
            f"that, the next ones are made by version {by}. Experiments and answers count as before."
        )
    if unknown := state.configuration["options"].keys() - kept_by(Options).keys():
        yield (
            f"This version of prefcal does not know {', '.join(sorted(unknown))}, with which this study was "
            "begun: it goes on without."
        )


def references(scenario: Scenario, seed: int, say: Callable[[str], None]) -> dict[str, Experiment]:
    """Run the reference θ; leave out those that fail, since the study itself is complete."""
    if scenario.source.asks or not scenario.references:
        return {}
    if scenario.source.hangs:
        say("The references did not run: the last run had to be ended.")
        return {}
    experiments: dict[str, Experiment] = {}
    for name, theta in scenario.references.items():
        try:
            experiments[name] = scenario.run(theta, seed=seed)
        except Exception as error:  # a rig can raise anything
            say(f"The reference {name!r} did not run: {error}")
    return experiments


def as_json(record: StudyRecord, options: Options, report: Path | None, simulated: int | None = 0) -> str:
    """Return the result as strict, indented JSON, with null for missing numbers or no report."""
    best = record.best
    content = {
        "best": None if best is None else record.scenario.space.named(best.experiment.theta),
        "cost": None if best is None else best.cost,
        "kpis": None if best is None else dict(best.experiment.kpis),
        "experiments": len(record.trials),
        "questions": record.questions,
        "simulated": simulated,
        "verdicts": record.verdict_counts(),
        "report": None if report is None else str(report),
        "scenario": options.scenario,
        "agent": options.agent,
        "calibrator": options.calibrator,
        "seed": options.seed,
        "study": options.study,
        "stopped": record.stopped,
    }
    return as_text(content)


_SIGNS = {None: ("  ", ""), True: (" ✓", "green"), False: (" ✗", "red")}
"""Sign and style of a value that meets its objective, or does not."""
_STYLES = {"yes": "green", "no": "red", "best": "bold blue"}  # style of a cell by its last class
_BETWEEN, _LEAST = 2, 20  # characters between columns, and the least that a column of longer names gets


def show(record: StudyRecord, report: Path, console: Console) -> None:
    """Print what was gained, the best θ next to the references, whether it holds, and the report's path."""
    # Imported here: options and messages need nothing that draws.
    from prefcal_app.report.export import verified_beside
    from prefcal_app.report.write import verdict_of

    if record.best is not None:
        gain, result = gain_of(record), result_table(record)
        if not gain["same"]:
            console.print(*_draw(gain["title"], gain["table"], console))
        console.print(*_draw(record.scenario.title, result, console))
        say(console, *filter(None, [gain["noise"], gain["back"] if gain["before"] else ""]))
        if record.scenario.source.candidates is None:
            best = report.parent / BEST
            verdict = verdict_of(record, verified_beside(best))
            say(console, verdict.replace(f"verify {BEST}", shlex.join(["verify", str(best)])))
            say(console, *filter(None, [tell_margins(record.margin_words)]))
    if record.kept:
        say(console, kept_text(record.kept))
    show_outlook(record, console)
    console.print(Text.assemble("Report: ", (str(report), "bold")), soft_wrap=True)


def show_outlook(record: StudyRecord, console: Console, said: Sequence[str] = ()) -> None:
    """Print whether to continue, and what is said of the result; not again what was `said`."""
    lines = () if record.outlook is None else record.outlook.lines
    for line in (*(each for each in record.robust if each not in lines), *lines):
        if line not in said:
            console.print(line, soft_wrap=True, markup=False, highlight=False)


def _draw(title: str, table: Mapping[str, Any], console: Console) -> Iterator[Table]:
    """Yield a table of the view for the console; columns for which there is no room are in further ones."""
    names = [plain(labeled(row["name"], row["unit"])) for row in table["rows"]]
    heads = [plain(column["name"]) for column in table["columns"][1:]]
    columns = [_texts([row["cells"][k] for row in table["rows"]]) for k in range(len(heads))]
    # Without a width, Rich breaks the words of values and keeps those of names.
    widths = [
        max(map(cell_len, [*head.split(), *(text.plain for text in texts)]))
        for head, texts in zip(heads, columns, strict=True)
    ]
    start, longest = 0, max(map(cell_len, names))
    while start < len(heads):
        stop, room = start + 1, console.width - min(_LEAST, longest) - widths[start] - _BETWEEN
        while stop < len(heads) and (room := room - widths[stop] - _BETWEEN) >= 0:
            stop += 1
        made = Table(
            title=plain(title) or None, title_style="bold", title_justify="left", box=None, pad_edge=False
        )
        made.padding = (0, _BETWEEN, 0, 0)
        made.add_column("", overflow="fold")
        for head, width in zip(heads[start:stop], widths[start:stop], strict=True):
            made.add_column(head, justify="right", width=width)
        for name, *cells in zip(names, *columns[start:stop], strict=True):
            made.add_row(name, *cells)
        yield made
        title, start = "", stop


def _texts(cells: Sequence[Mapping[str, Any]]) -> list[Text]:
    """Return the values of a column, with signs of whether they meet their objectives, if it has any."""
    signed = any(cell["met"] is not None for cell in cells)
    styles = [_STYLES.get(cell["kind"].rpartition(" ")[2], "") for cell in cells]
    signs = [_SIGNS[cell["met"]] if signed else "" for cell in cells]
    return [
        Text.assemble((c["text"], style), sign) for c, style, sign in zip(cells, styles, signs, strict=True)
    ]


def plain(text: str) -> str:
    """Return a name out of the user's file as text that moves no cursor and is no markup."""
    return escape(printable(text))
