"""Show the status: the best so far, what was tried and learned, and how consistent answers are."""

from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_app.report.record import above
from prefcal_app.session import Consistency, Interview, Now
from prefcal_app.session.kpi_index import trust_text
from prefcal_app.session.order import to_repeat
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.presentation.wording import knob_number

from .end import outlook_view
from .now import best_view, marks_of, simulated_view

_POINTS = 81
"""Number of points of a slice through the surrogate."""


def status_view(interview: Interview) -> dict[str, Any]:
    """Return STATUS for the page."""
    now = interview.now()
    consistency = interview.consistency
    seed = int(now.state.configuration["seed"])
    return {
        "best": best_view(interview, now),
        "tried": _tried(interview, now),
        "slices": _slices(interview, now),
        "consistency": {
            "text": in_words(consistency),
            "can_repeat": now.question is not None and to_repeat(now.state, seed) is not None,
        },
        "outlook": outlook_view(interview.outlook),
        "questions": interview.questions,
        "simulated": simulated_view(now),
        "trust": "" if (index := interview.index) is None else trust_text(index),
    }


def in_words(consistency: Consistency) -> str:
    """Return repeats and cycles as sentences."""
    if not consistency.repeated:
        repeats = "No question has been asked twice yet."
    else:
        repeats = (
            f"{consistency.agreed} of {consistency.repeated} repeated questions got the same "
            "answer."
        )
    if not consistency.cycles:
        return f"{repeats} The answers do not contradict each other."
    circles = "; ".join(" over ".join(str(i + 1) for i in cycle) for cycle in consistency.cycles)
    return f"{repeats} Preferred in a circle: {circles}."


def _knob_view(knob: Knob) -> dict[str, Any]:
    return {
        "name": knob.name, "unit": knob.unit, "scale": knob.scale, "low": float(knob.low),
        "high": float(knob.high), "integer": bool(knob.integer),
    }  # fmt: skip


def _tried(interview: Interview, now: Now) -> dict[str, Any]:
    state, space = now.state, interview.scenario.space
    winners = set(state.history.incumbents())
    interrupted = state.history.unsafe(automatic=True)
    return {
        "knobs": [_knob_view(knob) for knob in space],
        "experiments": [
            {
                "number": index + 1,
                "theta": list(state.history.samples[index].theta),
                "text": [
                    knob_number(k, v)
                    for k, v in zip(space, state.history.samples[index].theta, strict=True)
                ],
                "best": index == now.incumbent,
                "was_best": index in winners,
                "ended": interview.end(index).value,
                "marks": marks_of(state, index, interrupted),
            }
            for index in sorted(state.finished)
        ],
    }


def _slices(interview: Interview, now: Now) -> Any:
    """Return the learned cost along each knob through the best θ; None if nothing is learned."""
    surrogate = interview.surrogate
    if surrogate is None or now.incumbent is None:
        return None
    space, best = interview.scenario.space, interview.experiment(now.incumbent).theta
    tried = np.array(
        [now.state.history.samples[index].theta for index in sorted(now.state.finished)]
    )
    base = space.encode(best)
    paths = [_path(space, base, k) for k in range(len(space))]
    costs = [surrogate(thetas) for thetas in (tried, *paths)]
    lowest = float(min(cost.min() for cost in costs))
    seen = above(costs[0], lowest).tolist()
    slices = []
    for k, knob in enumerate(space):
        slices.append(
            {
                "knob": _knob_view(knob),
                "x": paths[k][:, k].tolist(),
                "y": above(costs[k + 1], lowest).tolist(),
                "samples": {"x": tried[:, k].tolist(), "y": seen},
                "best": float(best[k]),
            }
        )
    return slices


def _path(space: KnobSpace, base: Float[np.ndarray, " n"], k: int) -> Float[np.ndarray, "m n"]:
    """Return θ over the whole range of knob `k` through the cube point `base`, ascending."""
    z = np.repeat(base[None], _POINTS, axis=0)
    z[:, k] = np.linspace(0.0, 1.0, _POINTS)
    thetas = np.unique(np.array([space.decode(row) for row in z]), axis=0)
    return np.asarray(thetas[np.argsort(thetas[:, k])])
