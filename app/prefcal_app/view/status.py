"""Show the status: the best so far, what was tried and learned, and how consistent answers are."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_app.session import Consistency, Interview, Now
from prefcal_app.session.study.memory import trust_text
from prefcal_env.knobs.space import KnobSpace

from .end import outlook_view
from .now import best_view, marks_of, simulated_view
from .sides import knob_view, theta_texts

_POINTS = 81
"""Number of points of a slice through the surrogate."""


def status_view(interview: Interview) -> dict[str, Any]:
    """Return STATUS for the page."""
    now = interview.now()
    consistency = interview.known.consistency
    return {
        "best": best_view(interview, now),
        "tried": _tried(interview, now),
        "slices": _slices(interview, now),
        "consistency": {"text": in_words(consistency), "can_repeat": "repeat" in now.can},
        "outlook": outlook_view(interview.known.outlook),
        "questions": interview.known.questions,
        "simulated": simulated_view(now),
        "trust": "" if (index := interview.known.index) is None else trust_text(index),
    }


def in_words(consistency: Consistency) -> str:
    """Return repeats and cycles as sentences."""
    if not consistency.repeated:
        repeats = "No question has been asked twice yet."
    else:
        repeats = f"{consistency.agreed} of {consistency.repeated} repeated questions got the same answer."
    if not consistency.cycles:
        return f"{repeats} The answers do not contradict each other."
    circles = "; ".join(" over ".join(str(i + 1) for i in cycle) for cycle in consistency.cycles)
    return f"{repeats} Preferred in a circle: {circles}."


def _tried(interview: Interview, now: Now) -> dict[str, Any]:
    state, space = now.state, interview.scenario.space
    winners = set(state.history.incumbents())
    interrupted = state.history.unsafe(automatic=True)
    return {
        "knobs": [knob_view(knob) for knob in space],
        "experiments": [
            {
                "number": index + 1,
                "theta": list(state.history.samples[index].theta),
                "text": theta_texts(space, state.history.samples[index].theta),
                "best": index == now.incumbent,
                "was_best": index in winners,
                "ended": interview.past.end(index).value,
                "marks": marks_of(state, index, interrupted),
            }
            for index in sorted(state.finished)
        ],
    }


def _slices(interview: Interview, now: Now) -> list[dict[str, Any]] | None:
    surrogate = interview.known.surrogate
    if surrogate is None or now.incumbent is None:
        return None
    tried = [now.state.history.samples[index].theta for index in sorted(now.state.finished)]
    best = interview.past.experiment(now.incumbent).theta
    return slices_view(interview.scenario.space, best, np.array(tried), surrogate)


def slices_view(
    space: KnobSpace,
    best: Float[np.ndarray, " n"],
    tried: Float[np.ndarray, "N n"],
    surrogate: Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]],
) -> list[dict[str, Any]]:
    """Return the learned cost along each knob through the best θ, for the page and the report.

    Only the order of learned costs has a meaning: they are the square root of the difference to
    the lowest one shown, which emphasizes low ones.

    Args:
        space: Knobs.
        best: Best θ, physical, shape (n,).
        tried: θ of every experiment, physical, shape (N, n).
        surrogate: Learned cost of m physical θ.
    """
    base = space.encode(best)
    paths = [_path(space, base, k) for k in range(len(space))]
    costs = [surrogate(thetas) for thetas in (tried, *paths)]
    lowest = float(min(cost.min() for cost in costs))
    seen, *lines = (np.sqrt(np.maximum(cost - lowest, 0.0)).tolist() for cost in costs)
    return [
        {
            "knob": knob_view(knob),
            "x": paths[k][:, k].tolist(),
            "y": lines[k],
            "samples": {"x": tried[:, k].tolist(), "y": seen},
            "best": float(best[k]),
        }
        for k, knob in enumerate(space)
    ]


def _path(space: KnobSpace, base: Float[np.ndarray, " n"], k: int) -> Float[np.ndarray, "m n"]:
    """Return θ over the whole range of knob `k` through the cube point `base`, ascending."""
    z = np.repeat(base[None], _POINTS, axis=0)
    z[:, k] = np.linspace(0.0, 1.0, _POINTS)
    thetas = np.unique(np.array([space.decode(row) for row in z]), axis=0)
    return np.asarray(thetas[np.argsort(thetas[:, k])])
