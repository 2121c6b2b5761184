"""Extras that a test needs: without them it is skipped, with a word that names the extra."""

from importlib.util import find_spec

import numpy as np
import pytest

MODULES = {
    "peers": ("glis", "pyswarm", "optuna", "optuna_dashboard", "botorch", "gpytorch"),
    "rl": ("stable_baselines3", "torch"),
}


def need(extra: str) -> None:
    """Skip the test unless `extra` is installed."""
    missing = [name for name in MODULES[extra] if find_spec(name) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: pip install -e './benchmarks[{extra}]'")


@pytest.fixture
def quick_peers(monkeypatch):
    """The peers with searches too short to be any good: a test sees the same promises sooner."""
    need("peers")
    import botorch.fit
    import botorch.optim
    import glis.solvers as glis
    import optuna_dashboard.preferential.samplers.gp as gp

    pso, by_preference = glis.pso, glis.facquisition_pref_surrogate.py_func
    small = {"swarmsize": 5, "maxiter": 3}
    monkeypatch.setattr(glis, "pso", lambda *a, **k: pso(*a, **{**k, **small}))
    # Not compiled, which takes seconds. Compiled code has no objection to a bare float for ΔF.
    monkeypatch.setattr(glis, "facquisition", glis.facquisition.py_func)
    monkeypatch.setattr(
        glis, "facquisition_pref_surrogate", lambda *a: by_preference(*a[:5], np.float64(a[5]), *a[6:])
    )
    acquire = botorch.optim.optimize_acqf
    few = {"num_restarts": 1, "raw_samples": 8, "options": {"maxiter": 3}}
    monkeypatch.setattr(botorch.optim, "optimize_acqf", lambda **k: acquire(**{**k, **few}))
    monkeypatch.setattr(botorch.fit, "fit_gpytorch_mll", lambda mll, **_: mll.eval())
    monkeypatch.setattr(gp._PreferentialGP, "fit_params_EP", lambda *_: None)
