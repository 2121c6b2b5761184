"""A study survives SIGKILL at any instant: nothing acknowledged is lost, and it asks the same.

In full, 200 kills: `pytest -m campaign tests/scenarios/test_crash.py`.
"""

import os
import random
import signal
import subprocess
import sys
import time
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from prefcal_agents import GLISp
from prefcal_agents.screening.agent import Screening
from prefcal_app.session import Phase
from prefcal_env.study import verify
from support.interviews import answer_all, begin, proceed, reopened
from support.unseen import unseen
from toy_study import toy_scenario

N_MAX = 14
DRIVER = f"""
import sys
from pathlib import Path
sys.path[:0] = {[str(Path(__file__).parent), str(Path(__file__).parents[1])]!r}
from test_crash import KINDS, begun
from support.interviews import answer_all, reopened
path, kind = Path(sys.argv[1]), sys.argv[2]
interview = reopened(KINDS[kind][0](), path) if path.exists() else begun(kind, path)
print("ready", flush=True)
answer_all(interview, lambda number: print(number, flush=True))
"""
KINDS = {"glisp": (toy_scenario, GLISp), "screening": (lambda: unseen, partial(Screening, n_simulated=60))}
"""Scenario and agent of a study; the second simulates θ that nobody looks at."""


def begun(kind, path=None):
    """Begin a study of this kind."""
    scenario, agent = KINDS[kind]
    return begin(scenario(), n_max=N_MAX, path=path, agent=agent)


def next_query(now):
    """θ of the challenger and number of the incumbent that are compared next."""
    pending = None if now.pending is None else now.pending.theta
    return now.state.history.answered, pending, now.incumbent


def place(now):
    """How far a study has come: answers about new experiments, and follow-up answers."""
    return now.state.history.answered, len(now.state.history.follow_ups)


@cache
def undisturbed(kind):
    """The queries of a study that nobody kills, by `place`."""
    interview = begun(kind)
    queries = {}

    def note(now):
        queries[place(now)] = next_query(now)

    note(proceed(interview))
    answer_all(interview, lambda _: note(proceed(interview)))
    return queries


def kill_one(path, kind, dice):
    """Drive the study on and kill it at some instant: the acknowledged numbers.

    Mostly while it answers, which takes a quarter of a second; else while it starts or begins.
    """
    starting = dice.random() < 0.25
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVER, str(path), kind],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdout is not None
    if not starting:
        assert process.stdout.readline() == "ready\n"
    time.sleep(dice.uniform(0.5, 1.3) if starting else dice.uniform(0.0, 0.25))
    process.send_signal(signal.SIGKILL)
    lines = process.stdout.read().splitlines()
    process.wait()
    return [int(line) for line in lines if line.strip().isdigit()]


def survive(folder, kind, kills, seed):
    queries = undisturbed(kind)
    dice, study, counts, told = random.Random(seed), 0, [], 0
    path = folder / "study-0.prefcal"
    while len(counts) < kills:
        acknowledged = kill_one(path, kind, dice)
        if not path.exists():  # it had not begun yet
            assert acknowledged == []
            counts.append(0)
            continue
        assert verify(path) == ()
        interview = reopened(KINDS[kind][0](), path)
        now = proceed(interview)
        done = now.state.history.answered
        counts.append(done)
        # The first sample needs no answer; follow-ups are asked once all samples have one.
        told += len(acknowledged)
        recorded = done + len(now.state.history.follow_ups)
        assert recorded > told, "an acknowledged answer is gone"
        assert next_query(now) == queries[place(now)]
        interview.file.close()
        if now.phase is Phase.OVER:
            study, told = study + 1, 0
            path = folder / f"study-{study}.prefcal"
    return counts


@pytest.mark.parametrize("kind", KINDS)
def test_a_killed_study_loses_nothing_and_asks_the_same(tmp_path, kind):
    counts = survive(tmp_path, kind, kills=6, seed=1)
    assert len(set(counts)) > 1  # it was killed at several places


@pytest.mark.campaign
@pytest.mark.parametrize("kind", KINDS)
def test_two_hundred_kills(tmp_path, kind):
    counts = survive(tmp_path, kind, kills=200, seed=2)
    print(f"200 kills, after {np.bincount(counts).tolist()} answers")
