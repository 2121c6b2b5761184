"""How the bank of a screening agent grows from answer to answer."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.history.stages import Stages
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.space.feasible import Region
from prefcal_agents.utility.bank import Bank, columns_of
from prefcal_agents.utility.correction import Measured, corrected
from prefcal_agents.utility.pool import Pool
from prefcal_agents.utility.posterior import DRAWS, Lessons, updated
from prefcal_agents.utility.utilities import Scale, Utilities
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .simulations import ENOUGH, Simulations

_FIRST, _SECOND, _LATER = (0.2, 0.08), (0.2, 0.12), (0.0, 0.04)
"""Shares of the simulations, over the whole space and near the leaders: before the first question,
which must come soon; after the first answer; and after each later one."""
_ANSWERS = 10
"""Number of later answers that are followed by simulations; then all are used up."""
_ROUND = 50
"""Number of θ near the leaders after which leaders are chosen again."""
_JUDGES, _GUIDES = 256, 64
"""Numbers of draws that judge the whole bank, and that say where to simulate next."""
_LEADERS = 20
"""Number of the best θ of a draw that span the step."""
_BASES = 3
"""Number of the best θ of a draw from which a step starts."""
_STEP = (0.2, 0.8)
"""Smallest and largest multiple of the difference of two leaders."""
_MOVED = 0.8
"""Probability that a knob moves along."""
_JITTER = 0.01
"""Standard deviation of a random step, in units of the cube, where all leaders agree."""
_LEARN = 0
"""First stream of random numbers; the next ones place θ."""
_CORRECT = 1000
"""Stream that draws how the plant differs from the simulation."""
_POOL, _RECALLED = 2000, 10
"""Stream of the pool's draws before any answer, and number of the latest answers it has draws of."""


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What is known when a query is made.

    Args:
        bank: Simulated θ, with their measured KPIs where these are others.
        spread: Rows of the bank that fill the space, shape (r,).
        scale: How KPIs are measured.
        logs: Log distances of the KPIs that are expected, shape (m, k).
        utilities: Draws of what the person wants.
        costs: Cost of each θ in some of the draws, lower is better, shape (d, m).
        rough: Whether experiments measured other KPIs than those simulated.
    """

    bank: Bank
    spread: Int[np.ndarray, " r"]
    scale: Scale
    logs: Float[np.ndarray, "m k"]
    utilities: Utilities
    costs: Float[np.ndarray, "d m"]
    rough: bool


class Growth:
    """The stages of a study: a function of the record, and remembered.

    Copies of an agent share it. Nothing in it has to be saved: a restored agent simulates the same
    θ again.

    Args:
        simulations: Simulations of the study.
        space: Knobs to tune.
        n_simulated: Largest number of θ to simulate.
        seed: Seed of all randomness.
    """

    def __init__(self, simulations: Simulations, space: KnobSpace, n_simulated: int, seed: int) -> None:
        self.simulations = simulations
        self._space, self._seed = space, seed
        self._plan = _plan(n_simulated)
        self._design = latin_hypercube(space, sum(wide for wide, _ in self._plan), seed)
        self._stages = Stages(self._first, self._following)
        self._pooled: tuple[History, Pool] | None = None  # the latest one: it is large

    def stage(self, history: History) -> Stage:
        """Return what is known after `history`, simulating what was not simulated yet."""
        return self._stages.after(history)

    def pool(self, history: History) -> Pool:
        """Return the draws of the study so far, which say what other answers would teach.

        Raises:
            KeyError: If a sample is not in the bank.
        """
        known = self._pooled
        if known is None or known[0] != history:
            known = self._pooled = (history, self._pool(history))
        return known[1]

    def _pool(self, history: History) -> Pool:
        stage, last = self.stage(history), history.answered
        given = [(History(), Utilities.drawn(stage.scale, DRAWS, self._rng(history, _POOL)))]
        for count in range(max(last - _RECALLED, 1), last):
            past = history.until(count)
            earlier = self.stage(past)
            if earlier.scale.names == stage.scale.names:
                given.append((past, earlier.utilities))
        return Pool.of(stage.bank, stage.scale, stage.logs, [*given, (history, stage.utilities)])

    def due(self, history: History) -> int:
        """Return how many θ are simulated by the time of the query after `history`."""
        turn = max(history.answered - 1, 0)
        return sum(wide + near for wide, near in self._plan[: turn + 1])

    def works(self, z: Float[np.ndarray, " n"]) -> bool:
        """Simulate the θ of a point of the cube, shape (n,); return whether it can be shown.

        It has a finite KPI and, in a robust study, keeps the limits in all perturbed runs.
        """
        bank = self._simulated(*self._space.proposals(z[None]))
        return not bank.hopeless[0] and self.simulations.runs_kept(bank.thetas)[0] == ENOUGH

    def _first(self) -> Stage:
        """Return the stage before the first answer: leaders by what anybody may want."""
        wide, near = self._plan[0]
        bank = self._simulated(*self._space.proposals(self._design[:wide]))
        spread = np.arange(len(bank))
        scale = Scale.of(bank, spread, self.simulations.reading.limits)
        stage = self._stage(History(), bank, spread, scale, self._drawn(scale))
        return self._refined(History(), stage, near)

    def _stage(
        self,
        past: History,
        bank: Bank,
        spread: Int[np.ndarray, " r"],
        scale: Scale,
        utilities: Utilities,
        judges: int = _JUDGES,
    ) -> Stage:
        """Return the stage after `past`, given the bank as simulated."""
        some = utilities.take(np.arange(0, len(utilities), len(utilities) // judges))
        logs = expected = scale(bank)
        measured = Measured.of(bank, past, self.simulations.reading)
        seen, rows = measured.on(bank), measured.rows
        if len(rows) and scale.names:
            rng = self._rng(past, _CORRECT)
            logs = corrected(bank.z, logs, rows, scale(seen, rows.tolist()), len(some), rng)
            expected = np.median(logs, axis=0)
        costs = some.costs(logs)
        rough = len(rows) > 0
        return Stage(seen, spread, scale, expected, utilities, costs, rough)

    def _drawn(self, scale: Scale) -> Utilities:
        return Utilities.drawn(scale, DRAWS, self._rng(History(), _LEARN))

    def _following(self, past: History, before: History, stage: Stage) -> Stage:
        """Return the stage after `past`, given the one after `before`, a step earlier."""
        if past.answered == before.answered:
            return self._followed(past, before, stage)
        return self._grown(past, before, stage)

    def _grown(self, past: History, before: History, stage: Stage) -> Stage:
        """Return the stage after `past`, given the one after `before`, an answer earlier."""
        turn = past.answered - 1  # the first one is compared with nothing
        wide, near = self._plan[turn] if 0 < turn < len(self._plan) else (0, 0)
        bank, spread = self._widened(stage, past, turn, wide)
        scale, utilities = Scale.of(bank, spread, self.simulations.reading.limits), stage.utilities
        if scale.names != stage.scale.names:  # a KPI was always the same before: begin again
            before, utilities = History(), self._drawn(scale)
        elif not np.array_equal(scale.limits, stage.scale.limits):  # a KPI found a better value
            limits = np.where(np.isfinite(utilities.limits), scale.limits, np.inf)
            utilities = replace(utilities, limits=limits)
        utilities = self._learned(past, before, bank, scale, utilities)
        judges = _GUIDES if near else _JUDGES
        stage = self._stage(past, bank, spread, scale, utilities, judges)
        return self._refined(past, stage, near)

    def _followed(self, past: History, before: History, stage: Stage) -> Stage:
        """Return the stage after the follow-ups of `past`, which teach, but bring no new θ."""
        bank = self._simulated(stage.bank.z, stage.bank.thetas)
        utilities = self._learned(past, before, bank, stage.scale, stage.utilities)
        return self._stage(past, bank, stage.spread, stage.scale, utilities)

    def _widened(
        self, stage: Stage, past: History, turn: int, wide: int
    ) -> tuple[Bank, Int[np.ndarray, " r"]]:
        """Return the bank with the next `wide` θ of the design and all shown, and its design."""
        start = sum(count for count, _ in self._plan[:turn])
        z, thetas = self._space.proposals(self._design[start : start + wide])
        bank, old = self.extended(stage.bank, z, thetas), len(stage.bank)
        spread = np.append(stage.spread, np.arange(old, len(bank)))
        shown = [np.array([getattr(s, name) for s in past.samples]) for name in ("z", "theta")]
        return self.extended(bank, *shown), spread

    def _learned(
        self, past: History, before: History, bank: Bank, scale: Scale, utilities: Utilities
    ) -> Utilities:
        """Return draws given the answers of `past`, from draws given those of `before`."""
        if not past.lessons() and not past.unsafe():
            return utilities
        seen = Measured.of(bank, past, self.simulations.reading).on(bank)
        old, new = (Lessons.of(seen, scale, record) for record in (before, past))
        return updated(utilities, old, new, scale, self._rng(past, _LEARN))

    def _refined(self, past: History, stage: Stage, count: int) -> Stage:
        """Return the stage with `count` more θ near the leaders, in rounds if they are many."""
        if not count or not stage.scale.names:
            return stage
        rounds = max(count // _ROUND, 1)
        for number, part in enumerate(np.array_split(np.arange(count), rounds)):
            rng = self._rng(past, _LEARN + 1 + number)
            points = near_leaders(self._space, stage.bank.z, stage.costs, len(part), rng)
            z, thetas = self._space.proposals(points)
            kept = np.atleast_1d(self._space.allows(thetas))  # rounding may cross an edge
            bank = self.extended(stage.bank, z[kept], thetas[kept])
            judges = _GUIDES if number < rounds - 1 else _JUDGES
            stage = self._stage(past, bank, stage.spread, stage.scale, stage.utilities, judges)
        return stage

    def extended(self, bank: Bank, z: Float[np.ndarray, "j n"], thetas: Float[np.ndarray, "j n"]) -> Bank:
        """Return the bank with more θ, simulating what was not simulated yet."""
        return self._simulated(np.vstack([bank.z, z]), np.vstack([bank.thetas, thetas]))

    def _simulated(self, z: Float[np.ndarray, "j n"], thetas: Float[np.ndarray, "j n"]) -> Bank:
        """Return the bank of these θ, with their KPIs as people read them."""
        bank, reading = Bank.of(z, thetas, columns_of(self.simulations(thetas))), self.simulations.reading
        return replace(bank, kpis=reading.table(bank.names, bank.kpis))

    def _rng(self, past: History, stream: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, past.answered, len(past.follow_ups), stream])


def _plan(n_simulated: int) -> list[tuple[int, int]]:
    """Return how many θ to simulate for each answer: over the space, and near the leaders."""
    shares = np.array([_FIRST, _SECOND, *[_LATER] * _ANSWERS])
    counts = np.diff(np.round(n_simulated * np.cumsum(shares)), prepend=0.0).reshape(shares.shape)
    plan = [(int(wide), int(near)) for wide, near in counts]
    return [(max(plan[0][0], 1), plan[0][1]), *plan[1:]]


def near_leaders(
    space: KnobSpace,
    z: Float[np.ndarray, "m n"],
    costs: Float[np.ndarray, "s m"],
    count: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "count n"]:
    """Return points of the cube near the θ with the lowest costs, shape (count, n).

    Each point belongs to one draw: one of its best θ, plus a part of the difference of two of its
    leaders. So steps are long while leaders are far apart, and shrink with them.

    Source: R. Storn, K. Price, "Differential evolution" (1997).
    Deviation: the population is the leaders of one draw, and all simulated θ can be leaders.

    Args:
        space: Knobs to tune.
        z: Simulated points of the cube, shape (m, n).
        costs: Their costs in each draw, shape (s, m).
        count: Number of points.
        rng: Generator of the draws.
    """
    leaders = np.argsort(costs, axis=1, kind="stable")[:, :_LEADERS]
    drawn = leaders[rng.integers(len(leaders), size=count)]
    first = drawn[np.arange(count), rng.integers(min(_BASES, drawn.shape[1]), size=count)]
    pair = np.array([rng.choice(row, 2) for row in drawn])
    step = rng.uniform(*_STEP, (count, 1)) * (z[pair[:, 0]] - z[pair[:, 1]])
    step *= rng.random(step.shape) < _MOVED
    low, high = space.corners
    points = z[first] + step + _JITTER * rng.standard_normal(step.shape)
    points = np.clip(points, low, high)  # many optima lie at the edge
    if not space.constraints:
        return space.snap_all(points)
    region = Region(space)
    allowed = z[region.allows(z)]
    return region.repaired(points, allowed) if len(allowed) else space.snap_all(points)
