"""What a verification found, for tests of what is kept and shown of it."""

from prefcal_env.sources.varied import UNMODELED
from prefcal_scenarios.verification.said import Verified, WorstRun

FOUND = Verified(
    headline="Does not hold: 298 of 299 runs keep the stated limits.",
    statement="298 of 299 runs keep the stated limits.",
    limits_kept="Stated limits: a safe end.",
    margins_kept="Margins of the nominal loop: maximum sensitivity M_s 1.7, required ≤ 2: kept.",
    advice=("relax the limit of overshoot: with ≤ 9 % in place of ≤ 5 %, 299 of 299 runs hold",),
    share=0.99,
    bound=0.02,
    runs=299,
    planned=299,
    baseline="current tuning",
    kpis=(("overshoot [%]", "≤ 5", "1", "0", "2", "7", "5", "9"),),
    margins=(("gain margin [dB]", "12", "8"), ("phase margin [°]", "60", "44")),
    basis="the sampled loop",
    effects=("dead time (4.8 to 7.2 s): overshoot",),
    worst=(WorstRun("settling time misses its objective", {"dead time": 7.1}, 3, "acceptable"),),
    varied=(("dead time", "4.8 to 7.2 s", "stated"), ("noise of the sensors", "0 to 0.2 %", "usual")),
    left_out=(("sampling jitter", "a period has one length here"), *UNMODELED),
    scenario="toy",
    version="1.0",
    best="",
)
