"""The family of closed loops: textbook processes, process industry, motion, and some with an MPC."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf, sqrt
from types import MappingProxyType

import numpy as np

from prefcal_agents.registry import JUDGES
from prefcal_env.envs.task import StepSignal, Task
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.described.description import knob_of, listed
from prefcal_scenarios.scenario import Scenario

from .loop import Loop, TunedLQR, TunedPID
from .plants import (
    GRAVITY,
    BoostConverter,
    CartPole,
    CompiledPlant,
    Linear,
    QuadrupleTank,
    Servo,
    Steering,
    Tank,
)

# --- What the makers of the loops share: parameters, knobs and the usual task.

CASCADE = ("_outer", "_inner")  # suffixes of the knobs of a cascade
Vary = Callable[[float], float]  # function that returns the value to use in place of a positive nominal one


def nominal(value: float) -> float:
    """Return `value` itself: so the named loops are made."""
    return value


def step_task(
    plant: CompiledPlant,
    horizon: float,
    T_s: float,
    *,
    x0: Sequence[float],
    u0: Sequence[float],
    target: float,
    d: tuple[float, float],
    noise: Sequence[float],
) -> Task:
    """Return the task of a loop: references step at the start, and halfway a disturbance sets in.

    Args:
        plant: Plant of the loop.
        horizon: Duration of an experiment, in the plant's unit of time.
        T_s: Sampling time of the controller; a knob called T_s replaces it. It is rounded to a
            multiple of the plant's step.
        x0: State at the start, a steady one, n_x numbers.
        u0: Inputs at the start, n_u numbers.
        target: Reference of the first measured state; those of the others are where they start.
        d: Disturbance before and after it sets in.
        noise: Standard deviation of the noise of each measured state.
    """
    return Task(
        x0=np.array(x0, dtype=float),
        u0=np.array(u0, dtype=float),
        y_ref=StepSignal((target, *(x0[i] for i in plant.measured[1:]))),
        d=StepSignal(d[:1], ((horizon / 2, d[1:]),)),
        noise=np.array(noise, dtype=float),
        horizon=horizon,
        T_s=T_s,
        dense_step=plant.max_step,
    )


def knobs(text: str, *more: Knob) -> KnobSpace:
    """Return the space of knobs as in a scenario file, "K=0.1:20:log %/°C, b=0:1", and of `more`."""
    read = [knob_of(each) for each in listed([text])]
    own = [k if k.integer else replace(k, low=float(k.low), high=float(k.high)) for k in read]
    return KnobSpace([*own, *more])


# --- Four textbook processes, each with a PID.


def lag(vary: Vary = nominal) -> Loop:
    """Return a heat exchanger: two lags and a dead time."""
    gain, slow, fast = vary(0.8), vary(20.0), vary(8.0)
    plant = CompiledPlant(
        Linear(
            A=((-1 / slow, 1 / slow), (0.0, -1 / fast)), B=((0.0,), (gain / fast,)), E=((0.0,), (1 / fast,))
        ),
        states=(Channel("temperature", "°C", -20, 120), Channel("jacket temperature", "°C")),
        inputs=(Channel("valve", "%", 0, 100),),
        max_step=0.5,
        dead_time=vary(6.0),
    )
    return Loop(
        name="lag",
        title="PID of a heat exchanger",
        brief="The outlet of a heat exchanger is warmed up by 10 °C; later the inflow gets colder. "
        "The valve acts after a dead time.",
        plant=plant,
        controller=TunedPID(),
        space=knobs(
            "K=0.1:20:log %/°C, T_i=2:200:log s, T_d=0.2:40:log s, T_f=0.2:20:log s, b=0:1, T_t=1:200:log s"
        ),
        task=step_task(
            plant,
            400.0,
            1.0,
            x0=(gain * 50,) * 2,
            u0=(50.0,),
            target=gain * 50 + 10,
            d=(0.0, -8.0),
            noise=(0.1,),
        ),
    )


def integrating(vary: Vary = nominal) -> Loop:
    """Return a buffer tank, which integrates the difference of its flows."""
    rate, actuator = vary(0.05), vary(2.0)
    plant = CompiledPlant(
        Linear(A=((0.0, rate), (0.0, -1 / actuator)), B=((0.0,), (1 / actuator,)), E=((-rate,), (0.0,))),
        states=(Channel("level", "%", 0, 100), Channel("inflow", "%")),
        inputs=(Channel("valve", "%", 0, 100),),
        max_step=0.25,
        dead_time=vary(2.0),
    )
    return Loop(
        name="integrating",
        title="PID of a buffer tank",
        brief="The level of a buffer tank is raised by 10 %; later more flows out. The level "
        "integrates the difference of inflow and outflow.",
        plant=plant,
        controller=TunedPID(),
        space=knobs("K=0.2:20:log, T_i=3:300:log s, T_d=0.05:10:log s, T_f=0.1:10:log s, b=0:1"),
        task=step_task(
            plant, 200.0, 0.5, x0=(50.0, 40.0), u0=(40.0,), target=60.0, d=(40.0, 55.0), noise=(0.2,)
        ),
    )


def oscillatory(vary: Vary = nominal) -> Loop:
    """Return a flexible arm, whose oscillation hardly dies out by itself."""
    frequency, damping, actuator = vary(1.0), vary(0.1), vary(0.2)
    stiffness = frequency**2
    plant = CompiledPlant(
        Linear(
            A=((0.0, 1.0, 0.0), (-stiffness, -2 * damping * frequency, stiffness), (0.0, 0.0, -1 / actuator)),
            B=((0.0,), (0.0,), (1 / actuator,)),
            E=((0.0,), (stiffness,), (0.0,)),
        ),
        states=(Channel("position", "cm", -10, 10), Channel("speed", "cm/s"), Channel("actuator force", "N")),
        inputs=(Channel("force", "N", -3, 3),),
        max_step=0.05,
    )
    return Loop(
        name="oscillatory",
        title="PID of a flexible arm",
        brief="The tip of a flexible arm moves by 1 cm; later a force pushes it. Left alone, the "
        "arm oscillates for a long time.",
        plant=plant,
        controller=TunedPID(),
        space=knobs("K=0.03:10:log N/cm, T_i=0.1:10:log s, T_d=0.03:10:log s, T_f=0.02:2:log s, b=0:1"),
        task=step_task(plant, 60.0, 0.05, x0=(0.0,) * 3, u0=(0.0,), target=1.0, d=(0.0, 0.5), noise=(0.005,)),
    )


def unstable(vary: Vary = nominal) -> Loop:
    """Return an exothermic reactor, which runs away without control."""
    gain, growth, actuator = vary(1.0), vary(5.0), vary(0.3)
    plant = CompiledPlant(
        Linear(
            A=((1 / growth, gain / growth), (0.0, -1 / actuator)),
            B=((0.0,), (1 / actuator,)),
            E=((1 / growth,), (0.0,)),
        ),
        states=(Channel("temperature", "°C", -15, 15), Channel("heating", "°C")),
        inputs=(Channel("heating command", "°C", -20, 20),),
        max_step=0.05,
        dead_time=vary(0.4),
        time_unit="min",
    )
    return Loop(
        name="unstable",
        title="PID of an unstable reactor",
        brief="The temperature of an exothermic reactor is raised by 2 °C; later the reaction "
        "speeds up. Without control the temperature runs away.",
        plant=plant,
        controller=TunedPID(),
        space=knobs("K=1:20:log, T_i=1:100:log min, T_d=0.02:2:log min, T_f=0.02:1:log min, b=0:1"),
        task=step_task(plant, 40.0, 0.1, x0=(0.0, 0.0), u0=(0.0,), target=2.0, d=(0.0, 2.0), noise=(0.02,)),
    )


# --- Four mechanical and electrical plants, with a cascade or a linear quadratic regulator.


def servo(vary: Vary = nominal) -> Loop:
    """Return a servo drive with friction and backlash: position around speed."""
    plant = CompiledPlant(
        Servo(load=vary(0.02), coulomb=vary(0.05), half_gap=vary(0.01), stiffness=vary(20.0)),
        states=(
            Channel("load angle", "rad", -6, 6),
            Channel("motor speed", "rad/s"),
            Channel("load speed", "rad/s"),
            Channel("twist", "rad"),
        ),
        inputs=(Channel("torque", "N m", -2, 2),),
        max_step=0.004,
        measured=(0, 1),
    )
    return Loop(
        name="servo",
        title="Cascade of a servo drive",
        brief="A drive turns its load by 1 rad; later a torque pulls at the load. The gear has "
        "backlash and the load sticks.",
        plant=plant,
        controller=TunedPID(CASCADE, inner=(0.0, -20.0, 20.0)),
        space=knobs(
            "K_outer=2:60:log 1/s, T_i_outer=0.3:30:log s, K_inner=0.03:1:log N m s/rad, "
            "T_i_inner=0.03:3:log s, T_f_inner=0.001:0.03:log s, b_outer=0:1"
        ),
        task=step_task(
            plant, 4.0, 0.004, x0=(0.0,) * 4, u0=(0.0,), target=1.0, d=(0.0, 0.3), noise=(5e-4, 0.05)
        ),
    )


def cart_pole(vary: Vary = nominal) -> Loop:
    """Return a pole that is balanced on a cart: weights of an LQR, and its sampling time."""
    plant = CompiledPlant(
        CartPole(cart=vary(1.0), pole=vary(0.2), length=vary(0.6), friction=vary(0.3)),
        states=(
            Channel("position", "m", -2, 2),
            Channel("pole angle", "rad", -0.6, 0.6),
            Channel("speed", "m/s"),
            Channel("angular speed", "rad/s"),
        ),
        inputs=(Channel("force", "N", -10, 10),),
        max_step=0.01,
        measured=(0, 1, 2, 3),
    )
    return Loop(
        name="cart-pole",
        title="LQR of a cart with a pole",
        brief="A cart moves by 0.5 m and balances a pole; later a force pushes the cart.",
        plant=plant,
        controller=TunedLQR(fixed={"R": 1.0}),
        space=knobs(
            "Q_1=10:3e4:log, Q_2=1:1e4:log, Q_3=0.1:1e4:log, Q_4=0.1:1000:log, Q_z=0.001:1e4:log",
            Knob("T_s", 0.01, 0.1, "s", step=0.01),
        ),
        task=step_task(
            plant,
            10.0,
            0.02,
            x0=(0.0,) * 4,
            u0=(0.0,),
            target=0.5,
            d=(0.0, 1.5),
            noise=(1e-3, 2e-3, 0.01, 0.02),
        ),
        beside=1,
    )


def boost_converter(vary: Vary = nominal) -> Loop:
    """Return a boost converter: voltage around current."""
    parameters = BoostConverter(inductance=vary(0.2), capacitance=vary(0.47), load=vary(12.0))
    start = 18.0
    loss = start * parameters.resistance / parameters.load
    open_share = (parameters.supply + sqrt(parameters.supply**2 - 4 * start * loss)) / (2 * start)
    current = start / parameters.load / open_share
    plant = CompiledPlant(
        parameters,
        states=(Channel("voltage", "V", -5, 50), Channel("coil current", "A", -30, 40)),
        inputs=(Channel("duty cycle", "", 0.0, 0.8),),
        max_step=0.02,
        measured=(0, 1),
        time_unit="ms",
    )
    return Loop(
        name="boost-converter",
        title="Cascade of a boost converter",
        brief="A converter raises its output from 18 V to 24 V; later the load draws more current. "
        "A larger duty cycle first lowers the voltage.",
        plant=plant,
        controller=TunedPID(CASCADE, inner=(current, 0.0, 15.0)),
        space=knobs(
            "K_outer=0.03:3:log A/V, T_i_outer=0.1:20:log ms, K_inner=0.003:0.3:log 1/A, "
            "T_i_inner=0.03:3:log ms, T_f_outer=0.01:1:log ms, b_outer=0:1"
        ),
        task=step_task(
            plant,
            20.0,
            0.02,
            x0=(start, current),
            u0=(1 - open_share,),
            target=24.0,
            d=(0.0, 0.8),
            noise=(0.05, 0.05),
        ),
        beside=1,
    )


def steering(vary: Vary = nominal) -> Loop:
    """Return a vehicle that changes lanes: lateral position around heading."""
    plant = CompiledPlant(
        Steering(speed=vary(15.0), wheelbase=vary(2.8), lag=vary(0.15)),
        states=(
            Channel("lateral position", "m", -4, 8),
            Channel("heading", "rad", -1, 1),
            Channel("steering angle", "rad"),
        ),
        inputs=(Channel("steering command", "rad", -0.4, 0.4),),
        max_step=0.02,
        measured=(0, 1),
    )
    return Loop(
        name="steering",
        title="Cascade of a vehicle's steering",
        brief="A car moves over by 3.5 m; later side wind makes it drift.",
        plant=plant,
        controller=TunedPID(CASCADE, {"T_i_inner": inf}, inner=(0.0, -0.2, 0.2)),
        space=knobs(
            "K_outer=0.01:0.3:log rad/m, T_i_outer=3:300:log s, T_d_outer=0.01:1:log s, K_inner=0.1:5:log, "
            "T_f=0.005:0.5:log s, b_outer=0:1"
        ),
        task=step_task(
            plant, 20.0, 0.04, x0=(0.0,) * 3, u0=(0.0,), target=3.5, d=(0.0, 0.5), noise=(0.02, 0.002)
        ),
        beside=1,
    )


# --- Four plants of the process industry and of buildings, with several PIDs or a staged input.


def tank(vary: Vary = nominal) -> Loop:
    """Return a tank that widens upwards, so that its gain depends on the level."""
    parameters = Tank(bottom=vary(0.05), widening=vary(0.25), outlet=vary(4e-4), pump_gain=4e-5)
    start, target = 0.3, 0.6
    flow = parameters.outlet * sqrt(2 * GRAVITY * start)
    plant = CompiledPlant(
        parameters,
        states=(Channel("level", "m", 0.0, 1.0), Channel("pump flow", "m³/s")),
        inputs=(Channel("pump power", "%", 0, 100),),
        max_step=1.0,
    )
    return Loop(
        name="tank",
        title="PID of a tank that widens upwards",
        brief="The level of a tank is raised from 0.3 m to 0.6 m; later a leak opens. The tank "
        "must neither run dry nor overflow.",
        plant=plant,
        controller=TunedPID(),
        space=knobs(
            "K=20:2000:log %/m, T_i=10:1000:log s, T_d=0.2:20:log s, T_f=0.5:50:log s, b=0:1, T_t=5:500:log s"
        ),
        task=step_task(
            plant,
            600.0,
            2.0,
            x0=(start, flow),
            u0=(flow / parameters.pump_gain,),
            target=target,
            d=(0.0, -4e-4),
            noise=(0.003,),
        ),
    )


def quadruple_tank(vary: Vary = nominal) -> Loop:
    """Return Johansson's quadruple tank with a PI for each lower tank."""
    parameters = QuadrupleTank(outlet_1=vary(7.1e-6), outlet_2=vary(5.7e-6), pump_gain=vary(3.3e-6))
    u = 3.0
    levels = _resting_levels(parameters, u)
    plant = CompiledPlant(
        parameters,
        states=tuple(Channel(f"level {i}", "m", -0.001, 1.0) for i in range(1, 5)),
        inputs=(Channel("pump 1", "V", 0, 10), Channel("pump 2", "V", 0, 10)),
        max_step=1.5,
        measured=(0, 1),
    )
    return Loop(
        name="quadruple-tank",
        title="Two PIs of four tanks",
        brief="Two pumps fill four tanks, and each pump acts on both lower tanks. The level of "
        "tank 1 is raised by 3 cm while that of tank 2 stays; later more water flows into tank 1.",
        plant=plant,
        controller=TunedPID(suffixes=("_1", "_2")),
        space=knobs(
            "K_1=5:500:log V/m, T_i_1=5:500:log s, K_2=5:500:log V/m, T_i_2=5:500:log s, T_f=0.5:50:log s, "
            "b=0:1"
        ),
        task=step_task(
            plant,
            900.0,
            3.0,
            x0=levels,
            u0=(u, u),
            target=levels[0] + 0.03,
            d=(0.0, 2e-6),
            noise=(5e-4, 5e-4),
        ),
        controlled=2,
        beside=1,
    )


def _resting_levels(tanks: QuadrupleTank, u: float) -> tuple[float, ...]:
    """Return the levels [m] at which the tanks rest if both pumps have the voltage `u`."""
    up_1, up_2 = (1 - tanks.share_2) * u, (1 - tanks.share_1) * u
    flows = (
        (tanks.share_1 * u + up_1, tanks.outlet_1),
        (tanks.share_2 * u + up_2, tanks.outlet_2),
        (up_1, tanks.outlet_3),
        (up_2, tanks.outlet_4),
    )
    return tuple((tanks.pump_gain * flow / a) ** 2 / (2 * GRAVITY) for flow, a in flows)


def distillation(vary: Vary = nominal) -> Loop:
    """Return Skogestad's distillation column (LV configuration) with two PIs."""
    lag = vary(75.0)
    gains = ((0.878, -0.864), (1.082, -1.096))
    plant = CompiledPlant(
        Linear(
            A=((-1 / lag, 0.0), (0.0, -1 / lag)),
            B=tuple(tuple(g / lag for g in row) for row in gains),
            E=((0.5 / lag,), (0.6 / lag,)),
        ),
        states=(Channel("top", "%", -20, 20), Channel("bottom", "%", -20, 20)),
        inputs=(Channel("reflux", "kmol/min", -50, 50), Channel("boilup", "kmol/min", -50, 50)),
        max_step=0.5,
        measured=(0, 1),
        dead_time=vary(1.0),
        time_unit="min",
    )
    return Loop(
        name="distillation",
        title="Two PIs of a distillation column",
        brief="Reflux and boilup act almost alike on the purity at the top and at the bottom. The "
        "top is raised by 0.5 % while the bottom stays; later the feed changes.",
        plant=plant,
        controller=TunedPID(suffixes=("_1", "_2"), signs=(1.0, -1.0)),
        space=knobs(
            "K_1=1:60:log kmol/(min %), T_i_1=3:300:log min, K_2=1:60:log kmol/(min %), "
            "T_i_2=3:300:log min, T_f=0.2:20:log min, b=0:1"
        ),
        task=step_task(
            plant, 400.0, 1.0, x0=(0.0, 0.0), u0=(0.0, 0.0), target=0.5, d=(0.0, 1.0), noise=(0.005, 0.005)
        ),
        controlled=2,
        beside=1,
    )


_COLD, _ROOM = 5.0, 18.0  # outdoor and room temperature at the start, °C


def building(vary: Vary = nominal) -> Loop:
    """Return a heated room: the radiator is heated in four stages, the walls store heat."""
    parameters, start, power = _heated_room(vary)
    plant = CompiledPlant(
        parameters,
        states=(
            Channel("room temperature", "°C", 0, 40),
            Channel("radiator temperature", "°C"),
            Channel("wall temperature", "°C"),
        ),
        inputs=(Channel("heating power", "%", 0, 100),),
        max_step=1.0,
        time_unit="min",
    )
    return Loop(
        name="building",
        title="Heating with four stages",
        brief="A room is heated from 18 °C to 21 °C; later it gets colder outside. The heater has "
        "four stages, and every switch wears it.",
        plant=plant,
        controller=TunedPID(fixed={"stages": 4.0}),
        space=knobs(
            "K=2:200:log %/K, T_i=10:1000:log min, T_d=0.5:50:log min, T_f=0.5:50:log min, b=0:1, "
            "hysteresis=0:0.5"
        ),
        task=step_task(plant, 960.0, 2.0, x0=start, u0=(power,), target=21.0, d=(_COLD, -2.0), noise=(0.05,)),
        staged=True,
    )


def _heated_room(vary: Vary) -> tuple[Linear, tuple[float, ...], float]:
    """Return a plant with time constants in min, its state [°C] and its power [%] at the start."""
    air, inside, leak = 1 / vary(80.0), 1 / vary(60.0), 1 / vary(400.0)
    wall, outside, radiator, heating = 1 / 600, 1 / 3000, 1 / 15, 0.5
    walls = (wall * _ROOM + outside * _COLD) / (wall + outside)
    hot = _ROOM + (inside * (_ROOM - walls) + leak * (_ROOM - _COLD)) / air
    plant = Linear(
        A=((-air - inside - leak, air, inside), (radiator, -radiator, 0.0), (wall, 0.0, -wall - outside)),
        B=((0.0,), (radiator * heating,), (0.0,)),
        E=((leak,), (0.0,), (outside,)),
    )
    return plant, (_ROOM, hot, walls), (hot - _ROOM) / heating


# --- Three plants of the family with an MPC: horizons, weights and sampling time are tuned.


def _predictive(
    make: Callable[[Vary], Loop],
    title: str,
    scales: tuple[float, ...],
    moves: tuple[float, ...],
    process: tuple[float, ...],
    disturbed: tuple[tuple[int, ...], tuple[int, ...]],
    text: str,
    sampling: Knob,
) -> Callable[..., Loop]:
    """Return the maker of the loop that `make` makes, with an `TunedMPC` in place of its controller.

    `disturbed` holds the outputs and the inputs with a disturbance.
    """

    def maker(vary: Vary = nominal) -> Loop:
        # Here, since it loads the QP solver, which the other loops do without.
        from .mpc import TunedMPC

        loop = make(vary)
        assert loop.task.noise is not None
        noise = tuple(loop.task.noise.tolist())
        mpc = TunedMPC(scales, moves, noise, process, *disturbed, fixed={"Q_1": 1.0})
        name, space = f"mpc-{loop.name}", knobs(text, sampling)
        return replace(loop, name=name, title=title, controller=mpc, space=space)

    return maker


PREDICTIVE = {
    "mpc-oscillatory": _predictive(
        oscillatory,
        "MPC of a flexible arm",
        (1.0,),
        (1.0,),
        (1e-3, 1e-2, 1e-3),
        ((), (0,)),
        "N_p=4:40:int, N_u=1:10:int, Q_du=0.0001:10:log, drift=0.003:3:log",
        Knob("T_s", 0.4, 1.2, "s", step=0.1),
    ),
    "mpc-quadruple-tank": _predictive(
        quadruple_tank,
        "MPC of four tanks",
        (0.03, 0.03),
        (1.0, 1.0),
        (1e-4,) * 4,
        ((), (0, 1)),
        "N_p=4:40:int, N_u=1:8:int, Q_du=0.001:100:log, Q_2=0.03:30:log, drift=0.0001:0.1:log",
        Knob("T_s", 9.0, 24.0, "s", step=3.0),
    ),
    "mpc-boost-converter": _predictive(
        boost_converter,
        "MPC of a boost converter",
        (6.0, 6.0),
        (0.1,),
        (0.02, 0.02),
        ((1,), (0,)),
        "N_p=3:30:int, N_u=1:6:int, Q_du=0.0001:10:log, drift=0.003:3:log",
        Knob("T_s", 0.2, 0.5, "ms", step=0.02),
    ),
}
"""Makers of the loops with an MPC, by name."""


# --- The named closed loops.

_MAKERS = (
    *(lag, integrating, oscillatory, unstable),
    *(tank, quadruple_tank, distillation, building),
    *(servo, cart_pole, boost_converter, steering),
)
LOOPS: Mapping[str, Callable[..., Loop]] = MappingProxyType(
    {make.__name__.replace("_", "-"): make for make in _MAKERS} | PREDICTIVE
)
"""Makers of the loops by name; each takes a `Vary`."""


def named(name: str) -> Scenario:
    """Return the loop called `name` as a scenario, with its nominal parameters.

    Raises:
        ScenarioError: If no loop has this name.
    """
    if name not in LOOPS:
        raise ScenarioError(
            f"no loop is called {name!r}.{did_you_mean(name, LOOPS)} Expected {', '.join(LOOPS)}"
        )
    return judged(LOOPS[name]())


def judged(loop: Loop) -> Scenario:
    """Return the scenario with `JUDGES` as calibrators."""
    scenario = loop.scenario()
    calibrators = {name: make for judge in JUDGES for name, make in judge(scenario).items()}
    return replace(scenario, calibrators=calibrators)
