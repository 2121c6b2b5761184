"""Draw how the two algorithms learn, for docs/how_it_works.md: from real studies, not by hand."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from prefcal_agents import GLISp, Screening
from prefcal_bench.people import USUAL, sample, taste
from prefcal_env import Knob, KnobSpace, calibrate
from prefcal_scenarios import load, outcome
from prefcal_scenarios.runs import screened
from prefcal_scenarios.style import BEST, FAINT, FIRST, OTHERS, canvas, png, style

GAIN = KnobSpace([Knob("gain", 0.0, 10.0)])
MOMENTS = (4, 7, 10)  # numbers of experiments after which GLISp is drawn


def wish(gain: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Return what a person dislikes about each gain, unknown to the agent."""
    return np.asarray(0.3 + 0.05 * (gain - 6.5) ** 2 + 0.35 * np.sin(1.9 * gain))


def learning() -> tuple[Figure, Mapping[str, float]]:
    """Draw what GLISp has learned about one knob after some experiments, and what it tries next."""
    agent = GLISp(GAIN, n_init=4, n_max=max(MOMENTS) + 1, seed=1)
    figure = canvas(2.7)
    panels = dict(zip(MOMENTS, figure.subplots(1, len(MOMENTS), sharey=True), strict=True))
    grid = np.linspace(0.0, 10.0, 300)
    while not agent.done:
        query = agent.ask()
        new, old = query.challenger, query.incumbent
        answer = None if old is None else int(np.sign(wish(new.theta) - wish(old.theta))[0])
        agent.tell(query, answer)
        count = len(agent.samples)
        if count in panels:
            axes, tried = panels[count], np.array(agent.samples)[:, 0]
            best = agent.best[0]
            low, high = wish(tried).min(), wish(tried).max()
            axes.plot(
                grid,
                (wish(grid) - low) / (high - low),
                color=FIRST,
                ls=(0, (4, 2)),
                label="what the person wants: unknown",
            )
            axes.plot(grid, agent.surrogate(grid[:, None]), color=BEST, label="learned from answers")
            axes.plot(tried, agent.surrogate(tried[:, None]), "o", color=BEST, ms=5, label="experiments")
            axes.plot(best, agent.surrogate(np.array([[best]])), "*", color=BEST, ms=13, label="best so far")
            if not agent.done:
                axes.axvline(agent.ask().challenger.theta[0], color=OTHERS[0], ls=":", label="tried next")
            axes.set(title=f"{count} experiments, {count - 1} answers", xlabel="gain", ylim=(-0.35, 1.7))
    panels[MOMENTS[0]].set_ylabel("cost, lower is better")
    handles, labels = panels[MOMENTS[0]].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=5, columnspacing=1.2, handlelength=1.5)
    least = grid[np.argmin(wish(grid))]
    return figure, {"distance of GLISp's gain from the best": abs(float(agent.best[0] - least))}


def simulated() -> tuple[Figure, Mapping[str, float]]:
    """Draw everything that a study of the servo simulates, and the few experiments it shows."""
    servo = load("servo")
    person = taste("weights", servo.kpis, sample(servo, USUAL), seed=0).calibrator()
    agent = Screening(servo.space, simulate=lambda theta: screened(servo, servo.run(theta)), n_max=8, seed=0)
    for _ in calibrate(agent, servo.run, person, lambda run: outcome(servo, run)):
        pass
    names = list(agent.bank.names)
    i, j = names.index("error"), names.index("input_noise")
    kpis = agent.bank.kpis
    figure = canvas(3.6, 6.0)
    axes = figure.subplots()
    axes.loglog(kpis[:, i], kpis[:, j], ".", color="#aeb7c0", ms=3, label=f"{len(kpis)} simulated")
    shown = [screened(servo, servo.run(s)) for s in agent.samples]
    best = screened(servo, servo.run(agent.best))
    x, y = ([run[names[k]] for run in shown] for k in (i, j))
    axes.loglog(x, y, "o", color=OTHERS[0], ms=6, label=f"{len(shown)} shown, in this order")
    for number, at in enumerate(zip(x, y, strict=True), 1):
        axes.annotate(str(number), at, xytext=(6, 3), textcoords="offset points", color=FAINT)
    axes.loglog(best[names[i]], best[names[j]], "*", color=BEST, ms=15, label="best")
    units = {kpi.name: kpi.unit for kpi in servo.kpis}
    axes.set(
        xlabel=f"integrated error of load angle [{units[names[i]]}]",
        ylabel=f"noise in torque [{units[names[j]]}]",
    )
    figure.legend(loc="outside upper left", ncols=3, columnspacing=1.2)
    return figure, {"simulated": len(kpis), "shown": len(shown)}


def algorithm() -> tuple[dict[str, bytes], Mapping[str, float]]:
    """Draw both figures; return them and the numbers to keep."""
    pictures, story = {}, {}
    for file, draw in (("learning.png", learning), ("simulated.png", simulated)):
        with style():
            figure, told = draw()
            pictures[file] = png(figure)
        story |= told
    return pictures, story
