"""A study survives SIGKILL at any instant: nothing acknowledged is lost, and it asks the same.

In full, 200 kills: `pytest -m campaign tests/scenarios/test_crash.py`.
"""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from prefcal_env.study import verify
from prefcal_scenarios.app.session import Phase
from support.interviews import begin, proceed, reopened
from toy_study import toy_scenario

N_MAX = 14
DRIVER = f"""
import sys
from pathlib import Path
sys.path[:0] = {[str(Path(__file__).parents[1])]!r}
from support.interviews import answer_all, begin, reopened
from toy_study import toy_scenario
path = Path(sys.argv[1])
toy = toy_scenario()
interview = reopened(toy, path) if path.exists() else begin(toy, n_max={N_MAX}, path=path)
print("ready", flush=True)
answer_all(interview, lambda number: print(number, flush=True))
"""


def next_query(now):
    """θ of the challenger and number of the incumbent that are compared next."""
    pending = None if now.pending is None else now.pending.theta
    return now.state.history.answered, pending, now.incumbent


@pytest.fixture(scope="module")
def undisturbed():
    """The queries of a study that nobody kills, by the number of answers before."""
    from support.interviews import answer_all

    interview = begin(toy_scenario(), n_max=N_MAX)
    queries = {}
    proceed(interview)
    queries[1] = next_query(interview.now())
    answer_all(interview, lambda _: queries.update({(q := next_query(proceed(interview)))[0]: q}))
    return queries


def kill_one(path, dice):
    """Drive the study on and kill it at some instant: the acknowledged numbers.

    Mostly while it answers, which takes a quarter of a second; else while it starts or begins.
    """
    starting = dice.random() < 0.25
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVER, str(path)],
        stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert process.stdout is not None
    if not starting:
        assert process.stdout.readline() == "ready\n"
    time.sleep(dice.uniform(0.5, 1.3) if starting else dice.uniform(0.0, 0.25))
    process.send_signal(signal.SIGKILL)
    lines = process.stdout.read().splitlines()
    process.wait()
    return [int(line) for line in lines if line.strip().isdigit()]


def survive(folder, undisturbed, kills, seed):
    dice, study, counts, told = random.Random(seed), 0, [], 0
    path = folder / "study-0.prefcal"
    while len(counts) < kills:
        acknowledged = kill_one(path, dice)
        if not path.exists():  # it had not begun yet
            assert acknowledged == []
            counts.append(0)
            continue
        assert verify(path) == ()
        interview = reopened(toy_scenario(), path)
        now = proceed(interview)
        done = now.state.history.answered
        counts.append(done)
        # The first sample needs no answer; follow-ups are asked once all samples have one.
        told += len(acknowledged)
        recorded = done + len(now.state.history.follow_ups)
        assert recorded > told, "an acknowledged answer is gone"
        assert next_query(now) == undisturbed[done]
        interview.study.close()
        if now.phase is Phase.OVER:
            study, told = study + 1, 0
            path = folder / f"study-{study}.prefcal"
    return counts


def test_a_killed_study_loses_nothing_and_asks_the_same(tmp_path, undisturbed):
    counts = survive(tmp_path, undisturbed, kills=6, seed=1)
    assert len(set(counts)) > 1  # it was killed at several places


@pytest.mark.campaign
def test_two_hundred_kills(tmp_path, undisturbed):
    counts = survive(tmp_path, undisturbed, kills=200, seed=2)
    print(f"200 kills, after {np.bincount(counts).tolist()} answers")
