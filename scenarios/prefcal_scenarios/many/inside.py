"""Run θ after θ in a worker process, and send results in groups."""

import pickle
import signal
import time

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.own.own_line import as_exception, in_words
from prefcal_scenarios.processes.messages import Kind
from prefcal_scenarios.processes.serving import Link

from .results import Result
from .task import Task, failed, unpacked


def main(period: float) -> None:
    """Run all requests until the other end closes the pipe; the first request is the task.

    Args:
        period: Seconds after which results are sent; 0 to send each at once.
    """
    link = Link()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # prefcal handles Ctrl-C
    if (task := _task(link)) is None:
        return
    link.ready()
    while (request := link.requests.get()) is not None:
        _answer(link, task, request, period)


def _task(link: Link) -> Task | None:
    """Return the task; None if it cannot be loaded, which prefcal is told, or is not needed."""
    content = link.requests.get()
    try:
        return None if content is None else unpacked(content)
    except BaseException as error:
        link.say(Kind.ERROR, in_words(as_exception(error, "its file")).encode())
        return None


def _answer(link: Link, task: Task, request: bytes, period: float) -> None:
    """Run the θ of `request`, and send the results with the seconds that they took."""
    thetas, results, begun = pickle.loads(request), [], time.perf_counter()
    for number, theta in enumerate(thetas, 1):
        results.append(_sent(_run(task, theta)))
        now = time.perf_counter()
        if now - begun >= period or number == len(thetas):
            link.say(Kind.EXPERIMENT, pickle.dumps((results, now - begun)))
            results, begun = [], now


def _run(task: Task, theta: Float[np.ndarray, " n"]) -> Result:
    try:
        return task(theta)
    except KeyboardInterrupt as error:  # the code's own: Ctrl-C does not arrive here
        return failed(theta, error)


def _sent(result: Result) -> Result | bytes:
    """Return an experiment as bytes, and other results as they are."""
    if not isinstance(result, Experiment):
        return result
    from prefcal_env.study.codec import encode

    try:
        return encode(result)
    except Exception as error:  # it holds something that cannot be stored
        return failed(result.theta, error)
