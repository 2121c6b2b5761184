"""Which studies are worth a file: a start that was broken off at once leaves none behind."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.rig import Rig
from prefcal_env.studies import (
    Answered,
    Created,
    Event,
    Failed,
    Finished,
    Shown,
    StudyFile,
    Suggested,
    remove_study,
)
from prefcal_scenarios.cli.opening import Opened
from prefcal_scenarios.scenario import Scenario, is_built_in


def worth_keeping(file: StudyFile, scenario: Scenario) -> bool:
    """Whether a study holds more than what the same command brings back by itself.

    An answer, a mark or a note counts, one taken back too. So does every experiment, unless the
    scenario is one of ours, whose experiments are cheap simulations: nobody runs a rig twice.
    """
    if any(_by_somebody(recorded.event) for recorded in file.events()):
        return True
    ours = is_built_in(file.state.configuration["scenario"]) and not isinstance(scenario.run, Rig)
    return bool(file.state.finished) and not ours


def _by_somebody(event: Event) -> bool:
    if isinstance(event, Answered):
        return event.incumbent is not None  # the first experiment is compared with nothing
    return not isinstance(event, Created | Suggested | Finished | Failed | Shown)


@contextmanager
def kept_if_worth_it(
    opened: Opened, scenario: Scenario, say: Callable[[str], None]
) -> Iterator[Opened]:
    """Close a study at the end; remove it if it was started here and is not worth keeping.

    Args:
        opened: The study.
        scenario: What it calibrates.
        say: Told that the study was not kept, unless an error of ours is told anyway.
    """
    keep, refused = opened.resumed or opened.name is None, False
    try:
        with opened.file as file:
            try:
                yield opened
            except PrefcalError:
                refused = True
                raise
            finally:
                keep = keep or worth_keeping(file, scenario)
    finally:
        if not keep and _removed(opened.file.path) and not refused:
            say(f"No answer was given, so study {opened.name} was not kept.")


def _removed(path: str) -> bool:
    """Remove a study; whether it could be."""
    try:
        remove_study(path)
    except StudyError:
        return False  # open in another process, which may be about to fill it
    return True
