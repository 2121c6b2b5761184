"""What `prefcal studies index` does."""

from pathlib import Path

from prefcal_agents.learned_index import LearnedIndex
from prefcal_env.errors import StudyError
from prefcal_scenarios.cli.described import open_described
from prefcal_scenarios.cli.shelf import existing
from prefcal_scenarios.interview import Interview
from prefcal_scenarios.report.minded import Minded
from prefcal_scenarios.scenario import is_built_in, load

_COST = '''

SCENARIO = {source!r}


def cost(experiment):
    """The index of an experiment of the scenario, for `prefcal calibrate --agent glis --cost`."""
    from prefcal_scenarios import outcome

    return index(outcome(_scenario(), experiment))


@cache
def _scenario():
    from prefcal_scenarios import load

    return load(SCENARIO)
'''


def export_index(name: str, source: str | None, out: Path | None) -> tuple[Path, Minded]:
    """Write what the answers of the study called `name` teach as a Python module.

    Args:
        name: Of the study.
        source: The scenario that the user trusts, None: the built-in one of the study.
        out: The file; None: STUDY_index.py, in the present folder.

    Returns:
        The file, and what it comes to.

    Raises:
        StudyError: no such study, of a scenario that has to be named, whose answers say nothing
            of KPIs, or a file that cannot be written or is somebody's own.
    """
    path = existing(name)
    with open_described(path) as file:
        named = file.state.configuration["scenario"]
        if source is None and not is_built_in(named):
            # Those who send a study must not choose which program is run here.
            raise StudyError(
                f"study {name!r} calibrates {named!r}, which is a program: "
                f"if you trust it, add --scenario {named}"
            )
        scenario = load(source or named)
        interview = Interview(scenario, file, ahead=False, asks=False)
        index, importance = interview.index, interview.importance
    minded = Minded.of(index, importance, scenario)
    if index is None or minded is None:
        raise StudyError(
            f"study {name!r} says nothing of KPIs: that takes answers that prefer one experiment, "
            "and at least three experiments that differ in a KPI"
        )
    target = Path(f"{path.stem}_index.py") if out is None else out
    _write(target, module(index, source or named))
    return target, minded


def module(index: LearnedIndex, source: str) -> str:
    """A module with `index(kpis)`, and `cost(experiment)` for the scenario called `source`."""
    first = "\nfrom math import"
    text = index.to_python().replace(first, f"\nfrom functools import cache{first}", 1)
    return text + _COST.format(source=source)


def _write(target: Path, text: str) -> None:
    try:
        if target.exists() and not target.read_bytes().startswith(text[:40].encode()):
            raise StudyError(f"{target} is no index that was written before: take another --out")
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror or error}") from error
