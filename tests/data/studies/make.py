"""Write the studies of this version, which every later version must open, and what is true of them.

    python tests/data/studies/make.py [--again]

One is a person's study of a scenario of their own with the agent glisp, in which nearly everything
happens that a study can record; the other one is unattended, of the reactor with the agent
screening. Those of earlier versions, and the scenario, stay as they are: it refuses to overwrite a
file. `--again` replaces those of the version in pyproject.toml while that one is not released.
"""

import argparse
import json
import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from prefcal_app.cli.opening import open_study
from prefcal_app.session import Choice, Interview, Phase, Question
from prefcal_env.study import Noted, StudyFile
from prefcal_scenarios import load

HERE = Path(__file__).parent
ROOT = Path(__file__).parents[3]
OWN = "first_order.py:scenario"


def settled(interview: Interview) -> Question | None:
    """Run experiments until there is a question; return it, or None at the end."""
    while interview.now().phase is Phase.RUNNING:
        interview.work()
    interview.raise_problem()
    return interview.now().question


def choice(interview: Interview, question: Question) -> Choice:
    """Return what a person says who wants a small first KPI."""
    kpi = interview.scenario.kpis[0].name
    left, right = (s.experiment.kpis[kpi] for s in (question.left, question.right))
    return Choice.LEFT if left < right else Choice.RIGHT if right < left else Choice.SAME


def before(interview: Interview, question: Question, number: int) -> None:
    """Do what this person does before they answer question `number`, counted from 1."""
    if number == 2:
        interview.steps.mark(question.id, "right", "unsafe", True)
    elif number == 4:
        interview.steps.answer(question.id, Choice.LEFT, comment='by mistake: "θ ≤ 1"')
        interview.steps.undo(interview.now().version)
    elif number == 5:
        interview.steps.retract(2)
        interview.file.append(Noted("the second answer was about the wrong curve"))
    elif number == 6:
        space = interview.scenario.space
        middle = np.full(len(space), 0.5)
        interview.steps.ask_for(space.decode(space.snap(middle)))
    elif number == 8:
        interview.steps.repeat()


def persons_study(path: Path) -> None:
    """Answer, comment, mark, undo, retract, repeat, ask for a θ and take a note."""
    given = {
        "scenario": OWN,
        "agent": "glisp",
        "n_max": 9,
        "n_init": 4,
        "seed": 1,
        "questions_per_experiment": 3,
    }
    scenario = load(OWN)
    with open_study(given, scenario, str(path)).file as file:
        interview, number = Interview(scenario, file, ahead=False), 0
        while (question := settled(interview)) is not None:
            number += 1
            before(interview, question, number)
            question = settled(interview)
            said = Choice.CANNOT_TELL if number == 3 else choice(interview, question)
            if number == 7:
                interview.steps.give(question.id, replace(question.answer(said), strength=3.0))
            else:
                interview.steps.answer(question.id, said, comment="calmer" if number == 1 else "")
        interview.close()


def unattended_study(path: Path) -> None:
    """Let a simulated person answer the agent screening."""
    words = [
        "calibrate",
        "cstr",
        "--calibrator",
        "synthetic",
        "--simulate",
        "60",
        "--n-max",
        "4",
        "--seed",
        "2",
    ]
    with TemporaryDirectory() as folder:
        kept = ["--study", str(path), "--out", folder]
        subprocess.run([sys.executable, "-m", "prefcal_app", *words, *kept], check=True)


def facts(path: Path) -> dict[str, object]:
    """Return what must stay true of a study."""
    with StudyFile.open(path, clock=lambda: "") as file:
        state = file.state
        best = state.history.incumbent
        return {
            "kinds": sorted({type(each.event).__name__.lower() for each in file.events()}),
            "scenario": state.configuration["scenario"],
            "experiments": len(state.finished),
            "answers": len(state.answers),
            "best": best,
            "theta": list(state.history.samples[best].theta),
            "kpis of the best": dict(file.experiment(state.finished[best]).kpis),
        }


class RefusedError(Exception):
    """Writing the studies would name them wrongly or overwrite others."""


def present(installed: str, project: Path = ROOT / "pyproject.toml") -> str:
    """Return the version in `project`. Raises RefusedError if another one is installed."""
    named: str = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["version"]
    if named != installed:
        raise RefusedError(
            f"version {installed} is installed, but pyproject.toml names {named}: run pip install -e . first"
        )
    return named


def places(name: str, folder: Path = HERE, *, again: bool = False) -> dict[str, Path]:
    """Return the files of version `name` by agent, after removing them if they are made again.

    Raises RefusedError if one exists and `again` is false.
    """
    found = {agent: folder / f"{name}-{agent}.prefcal" for agent in MAKERS}
    every = [file for path in found.values() for file in (path, path.with_suffix(".json"))]
    there = [file.name for file in every if file.exists()]
    if there and not again:
        raise RefusedError(
            f"{', '.join(there)} exist already. Name the next version in pyproject.toml first, or, "
            f"if {name} is not released, replace them with --again"
        )
    for file in every:
        file.unlink(missing_ok=True)
    return found


MAKERS = {"glisp": persons_study, "screening": unattended_study}


def main() -> None:
    """Write both studies of the installed version, and their facts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--again", action="store_true", help="replace those of this version")
    given = parser.parse_args()
    os.chdir(HERE)  # the study keeps the name of its scenario as it is given
    try:
        found = places(present(version("prefcal")), again=given.again)
    except RefusedError as error:
        sys.exit(str(error))
    for agent, path in found.items():
        MAKERS[agent](path)
        content = json.dumps(facts(path), indent=2, ensure_ascii=False)
        path.with_suffix(".json").write_text(content + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
