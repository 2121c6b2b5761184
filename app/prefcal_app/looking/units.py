"""Convert a run to another unit of time: its instants, and the KPIs that depend on time."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.tables.units import SECONDS
from prefcal_scenarios.scenario import KPI


def in_time_unit(
    experiment: Experiment, kpis: Sequence[KPI], unit: str
) -> tuple[Experiment, tuple[KPI, ...]]:
    """Return a run and its KPIs with times in `unit`; unchanged if that is impossible.

    A KPI in minutes becomes one in seconds, one in m min one in m s. Rates such as m/min stay.

    Args:
        experiment: Run, with the unit of time of its channels.
        kpis: What its KPIs mean.
        unit: Wanted unit of time.
    """
    given = experiment.channels.time_unit
    if given == unit or given not in SECONDS or unit not in SECONDS:
        return experiment, tuple(kpis)
    factor = SECONDS[given] / SECONDS[unit]
    units = {kpi.name: _converted(kpi.unit, given, unit) for kpi in kpis}
    factors = {name: factor**power for name, (_, power) in units.items()}
    changed = (
        replace(
            kpi, unit=units[kpi.name][0],
            at_most=factors[kpi.name] * kpi.at_most, at_least=factors[kpi.name] * kpi.at_least,
        )
        for kpi in kpis
    )  # fmt: skip
    return _scaled(experiment, factor, factors, unit), tuple(changed)


def _converted(words: str, given: str, wanted: str) -> tuple[str, int]:
    """Return a KPI's unit with another unit of time, and how many times that occurs in it."""
    powers = {given: (wanted, 1), f"{given}²": (f"{wanted}²", 2)}
    parts = [powers.get(part, (part, 0)) for part in words.split(" ")]
    return " ".join(part for part, _ in parts), sum(power for _, power in parts)


def _scaled(
    experiment: Experiment, factor: float, factors: Mapping[str, float], unit: str
) -> Experiment:
    """Return `experiment` with its times multiplied by `factor`, and each KPI by its own."""
    return replace(
        experiment,
        t=factor * experiment.t,
        t_control=factor * experiment.t_control,
        channels=replace(experiment.channels, time_unit=unit),
        runs=tuple(_scaled(run, factor, factors, unit) for run in experiment.runs),
        kpis={name: value * _factor(name, factors) for name, value in experiment.kpis.items()},
    )


def _factor(name: str, factors: Mapping[str, float]) -> float:
    """Return the factor of a KPI, or of its value in one maneuver, "NAME (MANEUVER)"."""
    if name in factors:
        return factors[name]
    return next((f for known, f in factors.items() if name.startswith(f"{known} (")), 1.0)
