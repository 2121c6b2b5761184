"""Three plants of the family with an MPC: horizons, weights and sampling time are tuned."""

from dataclasses import replace

from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.cases.loops.controllers import Tunable
from prefcal_scenarios.cases.loops.loop import Loop, Vary, nominal

from .basic import knobs, oscillatory, ratio
from .motion import boost_converter
from .processes import quadruple_tank

_SAMPLE = 20
"""Random θ that show whether a loop is worth tuning: few, since an experiment takes 20 ms."""


def _horizons(N_p: tuple[int, int], N_u: int) -> tuple[Knob, Knob]:
    """Return the knobs of both horizons, in steps."""
    return Knob("N_p", *N_p, integer=True), Knob("N_u", 1, N_u, integer=True)


def _mpc(
    loop: Loop,
    scales: tuple[float, ...],
    moves: tuple[float, ...],
    process: tuple[float, ...],
    disturbed: tuple[tuple[int, ...], tuple[int, ...]],
) -> Tunable:
    """Return the MPC of a loop; `disturbed` holds the outputs and inputs with a disturbance."""
    # Here, since it loads the QP solver, which the other loops do without.
    from prefcal_scenarios.cases.loops.mpc import MPC

    return MPC(scales, moves, loop.task.noise, process, *disturbed, fixed={"Q_1": 1.0})


def mpc_oscillatory(vary: Vary = nominal) -> Loop:
    """Return the flexible arm of `oscillatory` with an MPC, which can damp it."""
    loop = oscillatory(vary)
    return replace(
        loop,
        name="mpc-oscillatory",
        title="MPC of a flexible arm",
        controller=_mpc(loop, (1.0,), (1.0,), (1e-3, 1e-2, 1e-3), ((), (0,))),
        space=knobs(
            *_horizons((4, 40), 10),
            ratio("Q_du", 1e-4, 10.0),
            ratio("drift", 0.003, 3.0),
            Knob("T_s", 0.4, 1.2, "s", step=0.1),
        ),
        sample=_SAMPLE,
    )


def mpc_quadruple_tank(vary: Vary = nominal) -> Loop:
    """Return the four tanks of `quadruple_tank` with one MPC for both pumps."""
    loop = quadruple_tank(vary)
    return replace(
        loop,
        name="mpc-quadruple-tank",
        title="MPC of four tanks",
        controller=_mpc(loop, (0.03, 0.03), (1.0, 1.0), (1e-4,) * 4, ((), (0, 1))),
        space=knobs(
            *_horizons((4, 40), 8),
            ratio("Q_du", 1e-3, 100.0),
            ratio("Q_2", 0.03, 30.0),
            ratio("drift", 1e-4, 0.1),
            Knob("T_s", 9.0, 24.0, "s", step=3.0),
        ),
        sample=_SAMPLE,
    )


def mpc_boost_converter(vary: Vary = nominal) -> Loop:
    """Return the converter of `boost_converter` with an MPC of voltage and current."""
    loop = boost_converter(vary)
    return replace(
        loop,
        name="mpc-boost-converter",
        title="MPC of a boost converter",
        controller=_mpc(loop, (6.0, 6.0), (0.1,), (0.02, 0.02), ((1,), (0,))),
        space=knobs(
            *_horizons((3, 30), 6),
            ratio("Q_du", 1e-4, 10.0),
            ratio("drift", 0.003, 3.0),
            Knob("T_s", 0.2, 0.5, "ms", step=0.02),
        ),
        sample=_SAMPLE,
    )
