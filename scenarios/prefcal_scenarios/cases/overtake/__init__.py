"""Provide the scenario of lane keeping and overtaking, section IV-B."""

from .controller import Supervisor as Supervisor
from .kpis import calibrator as calibrator
from .kpis import compute_kpis as compute_kpis
from .scenario import make_tuning_env as make_tuning_env
from .scenario import make_tuning_vector as make_tuning_vector
from .scenario import overtake as overtake
