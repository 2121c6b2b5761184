"""Judge identification: of random plants and their records, how often is the truth in the stated 90 %?

    python benchmarks/campaigns/identification.py --records 300

A plant lies in the 90 % if its response to a step is nowhere further from the middle of the sample, in
the spread of the sample, than nine of ten models of the sample are. The spread counts as half a percent
of the response at least, which nobody can see. Records are simulated by other code than what identifies.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import signal

from prefcal_env.errors import RecordError
from prefcal_env.plants.explained import respond
from prefcal_env.plants.identify import Identified, identify

# --- Random plants, and records of a step test, with all that plants and their sensors do to them.

KINDS = ("lags", "integrating", "inverse response", "oscillating")
_FINE = 20  # steps of the simulation in a sample


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """A plant and its record."""

    kind: str
    num: Float[np.ndarray, " a"]
    den: Float[np.ndarray, " b"]
    delay: float
    T: float  # dominant time constant
    t: Float[np.ndarray, " K"]
    u: Float[np.ndarray, " K"]
    y: Float[np.ndarray, " K"]
    noise: float  # standard deviation, as a share of the output's range
    drift: float  # likewise
    resolution: float  # of the actuator

    def step(self, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
        """Return the response to a unit step."""
        return simulated(self.num, self.den, self.delay, t, np.ones(len(t)))


def simulated(
    num: Float[np.ndarray, " a"],
    den: Float[np.ndarray, " b"],
    delay: float,
    t: Float[np.ndarray, " K"],
    u: Float[np.ndarray, " K"],
) -> Float[np.ndarray, " K"]:
    """Return the response to a held input on a fine grid, later by a whole number of its steps."""
    h, late = (t[1] - t[0]) / _FINE, round(delay / (t[1] - t[0]) * _FINE)
    fine = np.concatenate([np.zeros(late), np.repeat(u, _FINE)])[: len(u) * _FINE]
    sampled = signal.cont2discrete((num, den), h, "zoh")
    return np.asarray(signal.lfilter(np.ravel(sampled[0]), sampled[1], fine)[::_FINE])


def _plant(rng: np.random.Generator, kind: str, T: float) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator of a random plant of gain 1."""
    if kind == "oscillating":
        return np.array([1.0]), np.array([T * T, 2 * rng.uniform(0.25, 0.8) * T, 1.0])
    if kind == "integrating":
        num, den, others = (
            np.array([1 / T]),
            np.array([1.0, 0.0]),
            T * rng.uniform(0.05, 0.6, rng.integers(0, 3)),
        )
    elif kind == "inverse response":
        others = T * np.append(1.0, rng.uniform(0.2, 0.9, rng.integers(1, 3)))
        num, den = np.array([-T * rng.uniform(0.2, 0.8), 1.0]), np.ones(1)
    else:
        others = T * np.append(1.0, rng.uniform(0.05, 0.9, rng.integers(0, 4)))
        num, den = np.ones(1), np.ones(1)
    for lag in others:
        den = np.convolve(den, [lag, 1.0])
    return num, den


def truth(seed: int) -> Truth:
    """Return a random plant and its record: one step of the input, and often another one back."""
    rng, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    T = 10 ** rng.uniform(-0.5, 1.5)
    num, den = _plant(rng, kind, T)
    gain = rng.choice([-1, 1]) * 10 ** rng.uniform(-1, 1.5)
    delay = T * rng.choice([0.0, rng.uniform(0.05, 0.3), rng.uniform(0.3, 2.0)])
    total, n = (delay + 6 * T) * rng.uniform(0.9, 1.6) + T, int(10 ** rng.uniform(2.0, 3.2))
    t, size = np.linspace(0, total, n), rng.choice([-1, 1]) * rng.uniform(3, 20)
    delay = round(delay / t[1] * _FINE) * t[1] / _FINE
    u = np.where(t >= 0.1 * total, 40.0 + size, 40.0)
    if rng.random() < 0.4:
        u[t >= 0.57 * total] -= size * rng.uniform(0.5, 1.5)
    resolution = float(rng.choice([0.0, rng.uniform(0.1, 0.5)]))
    moved = np.round(u / resolution) * resolution if resolution else u
    y = simulated(gain * num, den, delay, t, moved - moved[0])
    reach = float(np.ptp(y))
    noise, drift = rng.uniform(0, 0.05), float(rng.choice([0.0, rng.uniform(-0.1, 0.1)]))
    y = y + 50 + reach * (noise * rng.standard_normal(n) + drift * t / total)
    return Truth(kind, gain * num, den, delay, T, t, u, y, noise, drift, resolution)


# --- Judge: is the truth among what was found?

_UNSEEN = 0.005  # smallest spread that counts, as a share of the response


@dataclass(frozen=True, slots=True)
class Judged:
    """How far the truth is from what was found."""

    inside: bool  # whether it lies in the 90 % of the sample
    rank: float  # share of the sample that is nearer to its middle than the truth
    error: float  # largest error of the best model, as a share of the response


def judged(plant: Truth, found: Identified) -> Judged:
    """Return how the truth compares with the sample, by the response to a step."""
    t = np.linspace(0, 6 * plant.T + plant.delay, 300)
    true = plant.step(t)
    made = np.array([respond(model, t[1], np.ones(len(t))) for model in found.models])
    size, middle = np.ptp(true), made.mean(axis=0)
    spread = made.std(axis=0) + _UNSEEN * size
    own = np.abs((made - middle) / spread).max(axis=1)
    off = float(np.abs((true - middle) / spread).max())
    error = float(np.abs(made[found.best] - true).max() / size)
    return Judged(off <= np.quantile(own, 0.9), float(np.mean(own < off)), error)


def campaign(seeds: range) -> Iterator[tuple[Truth, Judged | None, str]]:
    """Yield each plant, how it was found, and what was said of it; None for one that was refused."""
    for seed in seeds:
        plant = truth(seed)
        try:
            found = identify(plant.t, plant.u, plant.y, resolution=plant.resolution, seed=seed)
        except RecordError as error:
            yield plant, None, str(error)
        else:
            yield plant, judged(plant, found), found.reason


def main() -> None:
    """Print each record and what came of it, then the shares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=int, default=300, help="number of records (300)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first one (0)")
    given = parser.parse_args()
    made, since = [], time.process_time()
    for k, (plant, one, said) in enumerate(campaign(range(given.first, given.first + given.records))):
        made.append(one)
        late, n = plant.delay / plant.T, len(plant.t)
        about = f"{plant.kind}, order {len(plant.den) - 1}, delay {late:.2f} T, {n} rows"
        more = f"noise {plant.noise:.3f}, drift {plant.drift:+.2f}, resolution {plant.resolution:.2f}"
        how = (
            "refused"
            if one is None
            else f"{'in ' if one.inside else 'OUT'} {one.rank:.2f} error {one.error:.3f}"
        )
        print(f"{given.first + k} {about}, {more}: {how}; {said}", flush=True)
    found = [one for one in made if one is not None]
    inside, errors = np.mean([one.inside for one in found]), [one.error for one in found]
    print(f"\n{len(made)} records, {len(made) - len(found)} refused, {time.process_time() - since:.0f} s")
    print(f"truth in the 90 % sample: {100 * inside:.1f} %")
    print(
        f"largest error of the best model: median {np.median(errors):.3f}, "
        f"90 % {np.quantile(errors, 0.9):.3f}"
    )


if __name__ == "__main__":
    main()
