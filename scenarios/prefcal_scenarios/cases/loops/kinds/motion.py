"""Four mechanical and electrical plants, with a cascade or a linear quadratic regulator."""

from math import inf, sqrt

from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.cases.loops.controllers import LQR, PID
from prefcal_scenarios.cases.loops.loop import Loop, Task, Timing, Vary, nominal
from prefcal_scenarios.cases.loops.plants import BoostConverter, CartPole, Servo, Steering

from .basic import CASCADE, knobs, ratio


def servo(vary: Vary = nominal) -> Loop:
    """Return a servo drive with friction and backlash: position around speed."""
    plant = Servo(load=vary(0.02), coulomb=vary(0.05), half_gap=vary(0.01), stiffness=vary(20.0))
    return Loop(
        name="servo",
        title="Cascade of a servo drive",
        brief="A drive turns its load by 1 rad; later a torque pulls at the load. The gear has "
        "backlash and the load sticks.",
        plant=plant,
        controller=PID(CASCADE, inner=(0.0, -20.0, 20.0)),
        space=knobs(
            ratio("K_outer", 2.0, 60.0, "1/s"),
            ratio("T_i_outer", 0.3, 30.0, "s"),
            ratio("K_inner", 0.03, 1.0, "N m s/rad"),
            ratio("T_i_inner", 0.03, 3.0, "s"),
            ratio("T_f_inner", 0.001, 0.03, "s"),
            Knob("b_outer", 0.0, 1.0),
        ),
        states=(
            Channel("load angle", "rad", -6, 6),
            Channel("motor speed", "rad/s"),
            Channel("load speed", "rad/s"),
            Channel("twist", "rad"),
        ),
        inputs=(Channel("torque", "N m", -2, 2),),
        measured=(0, 1),
        task=Task((0.0,) * 4, (0.0,), (1.0, 0.0), ((0.0, 0.3),), (5e-4, 0.05)),
        timing=Timing(0.004, 4.0, 0.004, 2.0),
    )


def cart_pole(vary: Vary = nominal) -> Loop:
    """Return a pole that is balanced on a cart: weights of an LQR, and its sampling time."""
    plant = CartPole(cart=vary(1.0), pole=vary(0.2), length=vary(0.6), friction=vary(0.3))
    return Loop(
        name="cart-pole",
        title="LQR of a cart with a pole",
        brief="A cart moves by 0.5 m and balances a pole; later a force pushes the cart.",
        plant=plant,
        controller=LQR(fixed={"R": 1.0}),
        space=knobs(
            ratio("Q_1", 10.0, 3e4),
            ratio("Q_2", 1.0, 1e4),
            ratio("Q_3", 0.1, 1e4),
            ratio("Q_4", 0.1, 1e3),
            ratio("Q_z", 1e-3, 1e4),
            Knob("T_s", 0.01, 0.1, "s", step=0.01),
        ),
        states=(
            Channel("position", "m", -2, 2),
            Channel("pole angle", "rad", -0.6, 0.6),
            Channel("speed", "m/s"),
            Channel("angular speed", "rad/s"),
        ),
        inputs=(Channel("force", "N", -10, 10),),
        measured=(0, 1, 2, 3),
        task=Task((0.0,) * 4, (0.0,), (0.5, 0.0, 0.0, 0.0), ((0.0, 1.5),), (1e-3, 2e-3, 0.01, 0.02)),
        timing=Timing(0.01, 10.0, 0.02, 5.0),
        beside=1,
    )


def boost_converter(vary: Vary = nominal) -> Loop:
    """Return a boost converter: voltage around current."""
    plant = BoostConverter(inductance=vary(0.2), capacitance=vary(0.47), load=vary(12.0))
    start = 18.0
    loss = start * plant.resistance / plant.load
    open_share = (plant.supply + sqrt(plant.supply**2 - 4 * start * loss)) / (2 * start)
    current = start / plant.load / open_share
    return Loop(
        name="boost-converter",
        title="Cascade of a boost converter",
        brief="A converter raises its output from 18 V to 24 V; later the load draws more current. "
        "A larger duty cycle first lowers the voltage.",
        plant=plant,
        controller=PID(CASCADE, inner=(current, 0.0, 15.0)),
        space=knobs(
            ratio("K_outer", 0.03, 3.0, "A/V"),
            ratio("T_i_outer", 0.1, 20.0, "ms"),
            ratio("K_inner", 0.003, 0.3, "1/A"),
            ratio("T_i_inner", 0.03, 3.0, "ms"),
            ratio("T_f_outer", 0.01, 1.0, "ms"),
            Knob("b_outer", 0.0, 1.0),
        ),
        states=(Channel("voltage", "V", -5, 50), Channel("coil current", "A", -30, 40)),
        inputs=(Channel("duty cycle", "", 0.0, 0.8),),
        measured=(0, 1),
        task=Task((start, current), (1 - open_share,), (24.0, 0.0), ((0.0, 0.8),), (0.05, 0.05)),
        timing=Timing(0.02, 20.0, 0.02, 10.0, unit="ms"),
        beside=1,
    )


def steering(vary: Vary = nominal) -> Loop:
    """Return a vehicle that changes lanes: lateral position around heading."""
    plant = Steering(speed=vary(15.0), wheelbase=vary(2.8), lag=vary(0.15))
    return Loop(
        name="steering",
        title="Cascade of a vehicle's steering",
        brief="A car moves over by 3.5 m; later side wind makes it drift.",
        plant=plant,
        controller=PID(CASCADE, {"T_i_inner": inf}, inner=(0.0, -0.2, 0.2)),
        space=knobs(
            ratio("K_outer", 0.01, 0.3, "rad/m"),
            ratio("T_i_outer", 3.0, 300.0, "s"),
            ratio("T_d_outer", 0.01, 1.0, "s"),
            ratio("K_inner", 0.1, 5.0),
            ratio("T_f", 0.005, 0.5, "s"),
            Knob("b_outer", 0.0, 1.0),
        ),
        states=(
            Channel("lateral position", "m", -4, 8),
            Channel("heading", "rad", -1, 1),
            Channel("steering angle", "rad"),
        ),
        inputs=(Channel("steering command", "rad", -0.4, 0.4),),
        measured=(0, 1),
        task=Task((0.0,) * 3, (0.0,), (3.5, 0.0), ((0.0, 0.5),), (0.02, 0.002)),
        timing=Timing(0.02, 20.0, 0.04, 10.0),
        beside=1,
    )
