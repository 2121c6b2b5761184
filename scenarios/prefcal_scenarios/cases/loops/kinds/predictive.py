"""Three plants of the family with an MPC: horizons, weights and sampling time are tuned."""

from collections.abc import Callable
from dataclasses import replace

from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.cases.loops.loop import Loop

from .basic import oscillatory
from .motion import boost_converter
from .parts import Vary, knobs, nominal
from .processes import quadruple_tank


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
        from prefcal_scenarios.cases.loops.mpc import TunedMPC

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
