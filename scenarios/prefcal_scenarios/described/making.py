"""Make a `Scenario` of its description: the plant that a file names, a rig, and the rest."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.arrays import is_number
from prefcal_env.controllers.margins import MarginKPIs, margin_kpis
from prefcal_env.controllers.stored import from_data, kind_of
from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.errors import KnobError, PlantError, ScenarioError
from prefcal_env.experiments.experiment import Channel, Channels, Controller
from prefcal_env.experiments.kpis import every_tracking_kpi
from prefcal_env.experiments.panels import Panel, plots_of
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.optional import ENDINGS, WORLDS
from prefcal_env.plain import Keys
from prefcal_env.plants.systems import LIBRARIES
from prefcal_env.sources import Rig
from prefcal_env.sources.source import function_of
from prefcal_env.units import conversion
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.names import CONTROLLERS, either
from prefcal_scenarios.own import module_at
from prefcal_scenarios.scenario import KPI, Scenario, finds_kpis

from .description import KNOB_EXAMPLE, Description, description_of, limit_of, ranged_knob, stated
from .identified import is_record, plant_of_record

# --- Load the plant that a file, the command line or a study names: model.py:plant.

_PARTS = ("f", "g", "hold", "jacobians", "states", "inputs", "outputs")  # what every plant has
_KINDS = (
    f"a prefcal plant (FunctionPlant, Plant.of), a system of {LIBRARIES}, or a tuple of matrices (A, B, C, D)"
)


def plant_at(source: str) -> Any:
    """Return the plant at path/to/model.py:NAME, where the file is executed, or that of a record, step.csv.

    Raises:
        ScenarioError: If the file or the name in it does not exist, or it is not a plant.
        RecordError: If a record does not tell its plant.
    """
    if is_record(source):
        return plant_of_record(source)
    path, _, name = source.rpartition(":")
    if not path.endswith(".py") or not name:
        raise ScenarioError(
            f"a plant must be path/to/model.py:NAME or the record of a step test, step.csv, got {source!r}"
        )
    module = module_at(Path(path))
    there = [key for key in vars(module) if not key.startswith("_")]
    if name not in there:
        raise ScenarioError(f"nothing in {path!r} is called {name!r}.{did_you_mean(name, there)}")
    found = getattr(module, name)
    if is_number(found):  # a mere gain of a linear system, here most likely the wrong name
        raise ScenarioError(f"{source!r} must be {_KINDS}, got the number {found!r}")
    if not isinstance(found, type) and all(hasattr(found, part) for part in _PARTS):
        return found
    from prefcal_env.plants.plant import Plant

    try:
        return Plant.of(found)
    except (PlantError, TypeError) as error:
        raise ScenarioError(f"{source!r} must be {_KINDS}: {error}") from error


# --- Make a rig, a plant that only a person can run, of plain data.

_Signals = dict[str, dict[str, Any]]
_SIGNALS: Keys = {"outputs": (_Signals, True), "inputs": (_Signals, False), "time_unit": (str, False)}
"""Keys of a rig that are no arguments of `Rig`."""
_SENSOR: Keys = {"sensor": (tuple[float, float] | None, False)}
"""Key of a signal that is no argument of `Channel`."""


def rig_of(values: Mapping[str, Any], reference: Mapping[str, float], where: str) -> Rig:
    """Return the rig that the table [rig] of the file `where` describes, with references of outputs.

    Raises:
        ScenarioError: If a key is unknown or missing, or has the wrong type, or a reference names
            no output.
        ExperimentError: If a limit is not valid.
        SettingsError: If a range is not valid.
    """
    made = ("channels", "y_ref", "kpis", "ranges")
    given = stated(values, f"{where}, [rig]", _SIGNALS, Rig, known=made, partial=False)
    outputs, inputs = (
        {name: _signal(name, row, f"{where}, [rig.{group}] {name}") for name, row in rows.items()}
        for group, rows in (("outputs", given.pop("outputs")), ("inputs", given.pop("inputs", {})))
    )
    for name in reference:
        if name not in outputs:
            raise ScenarioError(
                f"{where}, [reference]: no output of the rig is called {name!r}."
                f"{did_you_mean(name, outputs)} There are {', '.join(outputs)}"
            )
    sensors = {name: row.pop("sensor", None) for name, row in (*outputs.items(), *inputs.items())}
    x = tuple(_channel(row, reference.get(name)) for name, row in outputs.items())
    y, u = tuple(c for c in x if c.target is not None), tuple(_channel(row) for row in inputs.values())
    return Rig(
        channels=Channels(x, u, y, given.pop("time_unit", "s")),
        y_ref=tuple(c.target for c in y if c.target is not None),
        ranges={name: sensor for name, sensor in sensors.items() if sensor is not None},
        instructions=given.pop("instructions", "").strip(),
        **given,
    )


def _signal(name: str, row: Mapping[str, Any], where: str) -> dict[str, Any]:
    return {"name": name, **stated(row, where, Channel, _SENSOR, known=("name", "target", "symbol"))}


def _channel(row: Mapping[str, Any], target: float | None = None) -> Channel:
    """Return a channel; only one with a target has a band."""
    return Channel(**{**row, "target": target, "band": row.get("band") if target is not None else None})


# --- Make a `Scenario` of its description.


def scenario_of(name: str, config: Mapping[str, Any] | None = None) -> Scenario:
    """Return the scenario that plain data describe.

    Args:
        name: Path of a TOML file or of a file of an optional world, or the name of a standard
            controller such as "pid".
        config: Keys of the description, in addition to those of the file.

    Raises:
        ScenarioError: If a file cannot be read, or the description is not valid; the message
            names the file, the table and the key.
    """
    description = description_of(name, {} if config is None else config)
    if description.timeout is not None:
        _check_timeout(description, name)
    knobs = [_knob(key, value, name) for key, value in description.knobs.items()]
    make = _of_rig if description.controller is None else _of_controller
    if description.world is not None:
        make = description.world.inside("prefcal_scenarios").described
    return _dress(make(description, knobs, name), description, name)


def _check_timeout(d: Description, where: str) -> None:
    for_files = either([world.called for world in WORLDS if world.ending] or ["nothing here"])
    if d.world is None:
        raise ScenarioError(f"{where}: timeout is for {for_files}; --run-timeout limits other runs")
    if not d.world.ending:
        raise ScenarioError(
            f"{where}: timeout above all tables is for {for_files}: write it below {d.world.example}"
        )


def _of_controller(d: Description, knobs: list[Knob], where: str) -> Scenario:
    assert d.controller is not None
    if d.controller not in CONTROLLERS:
        raise ScenarioError(
            f"{where}: controller must be one of {', '.join(CONTROLLERS)}, got {d.controller!r}."
            f"{did_you_mean(d.controller, CONTROLLERS)}".rstrip(".")
        )
    if not isinstance(d.plant, str):
        raise ScenarioError(
            f"the controller {d.controller!r} needs a plant: add --plant model.py:plant, or "
            'plant = "model.py:plant" in a file'
        )
    made: Scenario = _maker(d.controller)(
        plant_at(d.plant),
        knobs=knobs,
        reference=d.reference or None,
        horizon=d.stop_time,
        title=d.title,
        brief=d.brief,
    )
    return made


def controller_of(settings: Mapping[str, Any]) -> Controller | None:
    """Return the controller that the settings of a best.json describe; None if they need the scenario.

    Raises:
        SettingsError: If they describe one that cannot be.
    """
    kind = settings.get("controller")
    for word in (word for word, controller in CONTROLLERS.items() if controller == kind):
        _maker(word)  # its module says how the data are read
    if kind == "LinearMPC" and "model" not in settings:  # the scenario's own word for what it makes
        return None
    return None if kind_of(kind) is None else from_data(settings)


def _maker(word: str) -> Callable[..., Scenario]:
    """Return the function that makes the scenario of a standard controller for a plant."""
    module = import_module(f"prefcal_scenarios.described.{word}_scenario")
    made: Callable[..., Scenario] = getattr(module, f"{word}_scenario")
    return made


def _of_rig(d: Description, knobs: list[Knob], where: str) -> Scenario:
    assert d.rig is not None
    if d.stop_time is not None:
        raise ScenarioError(f"{where}: a rig has no stop_time: say it in its instructions")
    rig, name = rig_of(d.rig, d.reference, where), Path(where).stem
    if not knobs:
        raise ScenarioError(f"{where}: it needs knobs, for example [knobs] with {_ENTRY}")
    return Scenario(name, f"Rig {name}", KnobSpace(knobs), rig)


_ENTRY = 'K_p = "0.1:100:log %/m"'


def _knob(name: str, value: str | Mapping[str, Any], where: str) -> Knob:
    try:
        if isinstance(value, str):
            return ranged_knob(name, value)
        plain = {**value, "scale": "log10"} if value.get("scale") == "log" else value
        return Knob(name, **stated(plain, f"{where}, [knobs] {name}", Knob, partial=False))
    except KnobError as error:
        raise ScenarioError(f"{where}, [knobs]: {error}") from error
    except ScenarioError as error:
        shorter = str(error).replace(KNOB_EXAMPLE, _ENTRY)
        known = shorter.startswith(where)
        raise ScenarioError(shorter if known else f"{where}, [knobs]: {shorter}") from error


def _dress(made: Scenario, d: Description, where: str) -> Scenario:
    """Return the scenario with what the description says of any kind of scenario."""
    changes: dict[str, Any] = {"name": d.name or _name(where, d)}
    changes |= {key: getattr(d, key) for key in ("title", "brief") if getattr(d, key)}
    if d.simulated is not None:
        changes["simulated"] = d.simulated
    if d.kpis is not None:
        kpis = () if isinstance(d.kpis, str) else _kpis(d.kpis, made, f"{where}, [kpis]")
        changes |= _measuring(made, kpis)
    takes_show = d.world is not None and "show" in d.world.unit
    if d.panels or (d.show and not takes_show):
        changes["panels"] = _panels(d, made, where)
    starts = {name: _start(name, theta, made.space, where) for name, theta in d.starts.items()}
    return limited(replace(made, **changes, references={**made.references, **starts}), d.limits, where)


def limited(made: Scenario, limits: Sequence[str], where: str = "--limit") -> Scenario:
    """Return the scenario with limits of KPIs or margins, each a text such as "overshoot <= 10 %".

    Raises:
        ScenarioError: If one does not read like that, or there is no such KPI; the message begins with
            `where` it is stated.
    """
    if not limits:
        return made
    if finds_kpis(made):
        raise ScenarioError(f"{where}: a limit is for KPIs known before the first run: name them in [kpis]")
    channels, kpis, stated = made.source.channels, {kpi.name: kpi for kpi in made.kpis}, set[Any]()
    for text in limits:
        name, entry = limit_of(text)
        known = kpis | {key: kpi for key, kpi in _margins(made).items() if key not in kpis}
        name = next((key for key, kpi in known.items() if kpi.title == name), name)
        end = name, *(entry.keys() - {"unit"})
        if end in stated:
            raise ScenarioError(f"{where}: {name!r} is limited twice, the second time by {text!r}: leave one")
        stated.add(end)
        if name not in known:  # of others, no run has a value
            expected = f"{did_you_mean(name, known)} Expected one of {', '.join(known)}"
            raise ScenarioError(f"{where}: there is no KPI {name!r}.{expected}")
        kpis[name] = _kpi(name, entry, known, where, () if channels is None else every_tracking_kpi(channels))
    return replace(made, **_measuring(made, (*kpis.values(),)))


def _measuring(made: Scenario, kpis: tuple[KPI, ...]) -> dict[str, Any]:
    """Return these KPIs as a change of a scenario, with what computes those that are margins."""
    new = _margins(made).keys() & {kpi.name for kpi in kpis} - {kpi.name for kpi in made.kpis}
    return {"kpis": kpis, **(_measured(made) if new else {})}


def _measured(made: Scenario, **names: frozenset[str]) -> dict[str, Any]:
    return {"run": made.source.measured(lambda _: MarginKPIs(function_of(made.source), **names))}


def with_margins(made: Scenario) -> Scenario:
    """Return a scenario whose closed loop measures those margins that its KPIs name and its runs lack."""
    names = frozenset(_margins(made).keys() & {kpi.name for kpi in made.kpis if kpi.margin})
    return replace(made, **_measured(made, names=names)) if names else made


def _name(where: str, d: Description) -> str:
    """Return the scenario's name: that of its file, or of its controller and plant: "pid-pump".

    A plant that is only called "plant" is named as its file is.
    """
    if where.endswith((".toml", *ENDINGS)):
        return Path(where).stem
    file, _, plant = d.plant.rpartition(":") if isinstance(d.plant, str) else ("", "", "")
    name = re.sub(r"[^\w-]+", "-", Path(file).stem) if plant == "plant" else plant
    return f"{where}-{name}".rstrip("-")


def _kpis(
    stated: Mapping[str, float | str | Mapping[str, Any]], made: Scenario, where: str
) -> tuple[KPI, ...]:
    channels = made.source.channels
    known = {kpi.name: kpi for kpi in made.kpis}
    tracking = {} if channels is None else every_tracking_kpi(channels)
    if channels is not None:
        known = tracking | _margins(made) | known
    # Tracking KPIs are differences of outputs from their references.
    return tuple(_kpi(name, value, known, where, tracking) for name, value in stated.items())


def _margins(made: Scenario) -> dict[str, KPI]:
    """Return the margins that a file may name as KPIs; none if the loop is not known as one."""
    loop = function_of(made.source)
    if not isinstance(loop, ClosedLoop) or loop.channels is None:
        return {}
    return {kpi.name: kpi for kpi in margin_kpis(loop.channels.time_unit)}


def _kpi(
    name: str,
    value: float | str | Mapping[str, Any],
    known: Mapping[str, KPI],
    where: str,
    differences: Collection[str],
) -> KPI:
    """Return a KPI that is known by its name, or has a formula; lower is better unless it says more."""
    plain = {"at_most": value} if isinstance(value, float | int) else {"formula": value}
    table = value if isinstance(value, Mapping) else plain
    given = stated(table, f"{where} {name!r}", KPI, known=("name", "of"))
    if name not in known and "formula" not in given:
        raise ScenarioError(
            f"{where}: there is no KPI {name!r}.{did_you_mean(name, known)} "
            f'Expected one of {", ".join(known)}, or a formula such as {name!r} = "max(level) - 2"'
        )
    try:
        if "formula" not in given:
            return replace(known[name], **_in_its_unit(known[name], given, differences))
        aims = {"at_most", "at_least", "better"} & given.keys()
        return KPI(**{"name": name, "title": name, "better": None if aims else "lower", **given})
    except ScenarioError as error:
        raise ScenarioError(f"{where} {name!r}: {error}") from error


def _in_its_unit(kpi: KPI, given: dict[str, Any], differences: Collection[str]) -> dict[str, Any]:
    """Return what a file says of a KPI, with its numbers in the unit in which the KPI is computed."""
    unit = given.get("unit")
    if unit is None or (not kpi.unit and kpi.name in differences):  # an output may have no unit
        return given
    found = conversion(unit, kpi.unit or "1", difference=kpi.name in differences)
    if found is None or found.offset:  # whether a temperature is a difference is not known of others
        expected = kpi.unit or "1"
        raise ScenarioError(f"its unit must be {expected}, or one that converts into it, got {unit!r}")
    sizes = ("at_most", "at_least", "resolution")
    converted = {key: found.to(given[key]) for key in sizes if given.get(key) is not None}
    return {**given, **converted, "unit": kpi.unit}


def _panels(d: Description, made: Scenario, where: str) -> tuple[Panel, ...]:
    """Return the panels: those to show in their order, each with the look that the file gives."""
    looks = {n: stated(t, f"{where}, [panels] {n}", Panel) for n, t in d.panels.items()}
    channels = made.source.channels
    usual = {panel.name: panel for panel in made.panels}
    if not usual and channels is not None:
        usual = {plot.name: Panel(plot.name) for plot in plots_of(channels)}
    shown = d.show or [*usual, *(name for name in looks if name not in usual)]
    names = dict.fromkeys([*shown, *looks])
    return tuple(replace(usual.get(n, Panel(n)), **looks.get(n, {})) for n in names)


def _start(name: str, theta: Mapping[str, float], space: KnobSpace, where: str) -> Any:
    if theta.keys() != set(space.names):
        raise ScenarioError(
            f"{where}, [starts] {name}: expected a value for each of {', '.join(space.names)}, "
            f"got {', '.join(theta) or 'none'}"
        )
    return np.array([theta[knob] for knob in space.names])
