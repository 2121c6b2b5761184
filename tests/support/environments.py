"""The registered environments, and what each is made with."""

import prefcal_scenarios as prefcal_scenarios  # registers the tuning environments
from prefcal_env import ClosedLoop, Knob, KnobSpace
from support.short_runs import final_level
from support.tank import pi_of, tank_env

OWN = {
    "space": KnobSpace([Knob("K_p", 0.1, 2.0), Knob("K_i", 0.0, 1.0)]),
    "run": ClosedLoop(tank_env, pi_of),
    "score": final_level,
}
SUBJECTS = {
    "prefcal/CSTR-v0": {},
    "prefcal/CSTRTuning-v0": {},
    "prefcal/Experiment-v0": OWN,
    "prefcal/Overtake-v0": {},
    "prefcal/OvertakeTuning-v0": {},
}
