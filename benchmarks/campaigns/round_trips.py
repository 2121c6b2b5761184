"""Measure runs whose right values are known, by every door, and say which KPIs are wrong.

    python benchmarks/campaigns/round_trips.py --count 2000    # a minute or two on one core
    python benchmarks/campaigns/round_trips.py --count 200 --fmus 50    # needs fmpy and pythonfmu

Each run is the response of a loop of second order, of random damping, to a start, a step, two steps
or a ramp, at a random moment, sampled at random, with noise or without, in m, cm or mm and s or min.
Its overshoot, settling time and integrated error follow from the closed form on a fine grid. The
doors are `recorded`, `from_frame`, a rig and `look`, and an FMU whose set point is a variable.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.progress import track

from prefcal_app.looking.look import run_from
from prefcal_env import Channel, Channels, FMULoop, Knob, Rig, from_frame, recorded
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.tables.frame import TableColumns

Curve = Float[np.ndarray, " K"]
KINDS = ("start", "step", "steps", "ramp")
LENGTHS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
TIMES = {"s": 1.0, "min": 1 / 60}
LOUD = 4.5  # standard deviations that noise adds to a largest value, at most


@dataclass(frozen=True)
class RoundTrip:
    """A run whose right values are known, in m and s."""

    kind: str
    damping: float
    moment: float  # s, of the first change
    size: float  # m
    step: float  # s, of sampling
    noise: float  # m
    length: str
    time: str
    seed: int

    @classmethod
    def of(cls, seed: int) -> "RoundTrip":
        """Draw a run."""
        rng = np.random.default_rng([51, seed])
        size = float(rng.choice([-1, 1]) * 10 ** rng.uniform(-2, 2))
        step = float(10 ** rng.uniform(-2, -0.8))
        noise = abs(size) * float(rng.choice([0.0, 0.0, 0.001, 0.005]))
        kind, length, time = (str(rng.choice(list(each))) for each in (KINDS, LENGTHS, TIMES))
        moment = 0.0 if kind == "start" else step * round(rng.uniform(1, 20) / step)
        return cls(kind, float(rng.uniform(0.2, 0.95)), moment, size, step, noise, length, time, seed)

    def curves(self, t: Curve) -> tuple[Curve, Curve]:
        """Return output and reference without noise at the times `t`, in m."""
        s = t - self.moment
        y, r = self.size * self._answer(s), np.where(s >= -1e-9, self.size, 0.0)
        if self.kind == "steps":
            y = y - 0.5 * self.size * self._answer(s - 40)
            r = r - np.where(s >= 40 - 1e-9, 0.5 * self.size, 0.0)
        elif self.kind == "ramp":
            y = self.size / 8 * (self._ramp(s) - self._ramp(s - 8))
            r = self.size * np.clip(s, 0, 8) / 8
        return y, r

    def _answer(self, s: Curve) -> Curve:
        s, d, root = np.maximum(s, 0.0), self.damping, np.sqrt(1 - self.damping**2)
        return np.asarray(1 - np.exp(-d * s) * (np.cos(root * s) + d / root * np.sin(root * s)))

    def _ramp(self, s: Curve) -> Curve:
        """Return the response to a ramp of slope 1: the integral of that to a step."""
        s, d, root = np.maximum(s, 0.0), self.damping, np.sqrt(1 - self.damping**2)
        wave = 2 * d * np.cos(root * s) + (2 * d**2 - 1) / root * np.sin(root * s)
        return np.asarray(s - 2 * d + np.exp(-d * s) * wave)

    def sampled(self) -> tuple[Curve, Curve, Curve]:
        """Return times, output and reference as they are logged, in m and s."""
        t = np.arange(0.0, self.moment + 80.0, self.step)
        y, r = self.curves(t)
        return t, y + self.noise * np.random.default_rng(self.seed).standard_normal(len(t)), r

    def right(self) -> dict[str, tuple[float, float]]:
        """Return the middle of the right values of each KPI in m and s, and by how much it may be missed."""
        t = np.linspace(0.0, self.moment + 80.0, 200_001)
        y, r = self.curves(t)
        ends = [(self.moment, self.size, self.moment + (40 if self.kind == "steps" else 80))]
        if self.kind == "steps":
            ends.append((self.moment + 40, -0.5 * self.size, self.moment + 80))
        miss = abs(self.size) * self.step**2 / 8  # a peak between two samples is not seen whole
        over, settled = [], []
        for begin, change, end in ends:
            rows = (t >= begin - 1e-9) & (t < end)
            aim, off = r[rows][-1], np.abs((y - r)[rows])
            over.append(max(float((np.sign(change) * (y[rows] - aim)).max()), 0.0))
            settled.append([_last(t[rows], off, 0.03 * abs(change) + d) - begin for d in (miss, -miss)])
        found = {"overshoot": (max(over), abs(self.size) * self.step**2 + LOUD * self.noise)}
        if not self.noise:  # it adds an area of its own, and moves the last entry into the band
            area = float(np.trapezoid(np.abs(y - r), t))
            # The second step is seen with the next sample, so that up to this much area is not.
            late = 0.5 * abs(self.size) * self.step if self.kind == "steps" else 0.0
            found["integrated error"] = (area - late / 2, 0.02 * area + late / 2)
            least, most = np.max(settled, axis=0).tolist()
            found["settling time"] = ((least + most) / 2, (most - least) / 2 + 1.01 * self.step + 1e-3)
        return found


def _last(t: Curve, off: Curve, band: float) -> float:
    """Return when a distance `off` is last beyond `band`; the first time if it never is."""
    outside = np.flatnonzero(off > band)
    return float(t[outside[-1]] if len(outside) else t[0])


FMU = """
import math

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Loop(Fmi2Slave):
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=100.0, step_size=0.05)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.damping, self.moment, self.size, self.y, self.ref = 0.5, 1.0, 1.0, 0.0, 0.0
        kind = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        for name in ("damping", "moment", "size"):
            self.register_variable(Real(name, **kind))
        for name in ("y", "ref"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        s, d, root = current_time + step_size - self.moment, self.damping, math.sqrt(1 - self.damping**2)
        self.ref = self.size if s >= -1e-9 else 0.0
        s = max(s, 0.0)
        wave = math.cos(root * s) + d / root * math.sin(root * s)
        self.y = self.size * (1 - math.exp(-d * s) * wave)
        return True
"""


def fmu_in(folder: Path) -> FMULoop:
    """Return a loop of second order, in a folder, whose set point steps when a knob says."""
    from pythonfmu import FmuBuilder

    (folder / "loop.py").write_text(FMU)
    path = FmuBuilder.build_FMU(str(folder / "loop.py"), dest=str(folder))
    knobs = (Knob("damping", 0.1, 0.99), Knob("moment", 0.0, 30.0), Knob("size", -1e3, 1e3))
    return FMULoop(path, knobs, ["y"], [], {"y": "ref"}, output_interval=0.05)


def doors(case: RoundTrip, folder: Path) -> Iterator[tuple[str, Mapping[str, float]]]:
    """Yield the name of each door and the KPIs by it, in m and s."""
    t, y, r = case.sampled()
    long, slow = LENGTHS[case.length], TIMES[case.time]
    yield "recorded", recorded([1.0], t, {"y": y}, reference={"y": r}).kpis
    columns = (t * slow, y * long, r * long)
    rows = "\n".join(",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns), strict=True))
    text = f"time [{case.time}],y [{case.length}],y ref [{case.length}]\n{rows}\n"
    (folder / "run.csv").write_text(text)
    yield "from_frame", from_frame(text, [1.0], units={"y": "m"}, time_unit="s").kpis
    rig = Rig(Channels((), (), (Channel("y", "m"),), "s"), (0.0,), kpis=tracking_kpis)
    yield "rig", rig.read(text, np.array([1.0])).kpis
    about = TableColumns(units={"y": "m"}, time_unit="s")
    yield "look", run_from(folder / "run.csv", about).experiment.kpis


def wrong(case: RoundTrip, folder: Path, fmu: FMULoop | None = None) -> Iterator[str]:
    """Yield each KPI that is not right by a door, in words."""
    found = dict(doors(case, folder))
    if fmu is not None and case.kind == "step" and not case.noise:
        case = replace(case, step=0.05, moment=0.05 * round(case.moment / 0.05))
        found = {"FMU": fmu(np.array([case.damping, case.moment, case.size])).kpis}
    for name, (right, slack) in case.right().items():
        for door, kpis in found.items():
            got = kpis.get(f"{name} of y", np.nan)
            if not abs(got - right) <= slack + 1e-6 * abs(right):
                yield f"{case}: {name} by {door} is {got:.6g}, right {right:.6g} within {slack:.2g}"


def main() -> int:
    """Try all runs; return 1 if a KPI is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2000, help="number of runs")
    parser.add_argument("--fmus", type=int, default=0, help="how many of the first runs an FMU repeats")
    options = parser.parse_args()
    complaints: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        fmu = fmu_in(Path(place)) if options.fmus else None
        for seed in track(range(options.count), "runs"):
            complaints += wrong(RoundTrip.of(seed), Path(place))
            if seed < options.fmus:
                complaints += wrong(RoundTrip.of(seed), Path(place), fmu)
        if fmu is not None:
            fmu.close()
    print(*complaints[:20], f"{options.count} runs by four doors: {len(complaints)} values wrong", sep="\n")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
