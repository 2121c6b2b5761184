"""Kill the scheduler of a Dask cluster in the middle of a study: nothing may be lost.

    pip install 'prefcal[dask]'
    python benchmarks/checks/outside/lost_scheduler.py        # half a minute

Four experiments run at once on a cluster of one worker. After the eighth answer its scheduler is
killed. Checked: the study ends with an error that says so, all answers and the pending experiments
are still there, and another loop, without a cluster, finishes the study with every θ that was
proposed, running none of them twice.
"""

import argparse
import socket
import subprocess
import sys
import time

import numpy as np
from distributed import Client
from jaxtyping import Float

from prefcal_agents import GLISp
from prefcal_env import Knob, KnobSpace
from prefcal_env.errors import RunError
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.loop import ask_and_tell

_ANSWERS, _EXPERIMENTS, _AT_ONCE = 8, 25, 4
_PATIENCE = 20
"""Seconds that the client waits for a scheduler, at the start and when it is lost."""


def main() -> None:
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = _started("scheduler", "--port", f"{port}", "--dashboard-address", ":0")
    worker = _started("worker", address, "--nthreads", "2", "--no-dashboard")
    try:
        with Client(address, timeout=_PATIENCE) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(1)
            print(study(client, scheduler))
    finally:
        worker.kill()
        scheduler.kill()


def study(client: Client, scheduler: subprocess.Popen[bytes]) -> str:
    """Run the study, and return what was found. Raises AssertionError if something was lost."""
    agent = GLISp(KnobSpace([Knob("x", -2, 2), Knob("y", -1, 1)]), n_max=_EXPERIMENTS, seed=0)
    answers = 0

    def answer(new: float, old: float | None) -> Answer:
        return Answer(None if old is None else int(np.sign(new - old)))

    begun = time.monotonic()
    try:
        executor = client.get_executor()  # type: ignore[no-untyped-call]
        for _ in ask_and_tell(agent, cost, answer, at_once=_AT_ONCE, executor=executor):
            answers += 1
            if answers == _ANSWERS:
                scheduler.kill()
    except RunError as error:
        after, words = time.monotonic() - begun, str(error)
    else:
        raise AssertionError("the study did not notice that the scheduler is gone")
    kept = agent.history
    pending = [query.challenger.theta for query in agent.ask(_AT_ONCE)]
    assert kept.answered == answers, (kept.answered, answers)
    for _ in ask_and_tell(agent, cost, answer, at_once=_AT_ONCE):
        pass
    assert agent.history.samples[: kept.answered] == kept.samples[: kept.answered]
    ran = {tuple(theta) for theta in agent.samples}
    assert ran >= {tuple(theta) for theta in pending}
    assert len(ran) == _EXPERIMENTS
    return f"{words!r} after {after:.0f} s; {answers} answers and {len(pending)} pending were kept"


def cost(theta: Float[np.ndarray, " n"]) -> float:
    """Return the cost of an experiment of a fifth of a second."""
    time.sleep(0.2)
    return float((theta[0] - 1) ** 2 + 5 * (theta[1] - theta[0] / 4) ** 2)


def _started(kind: str, *words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
