"""Provide the scenario of the continuous stirred tank reactor, section IV-A."""

from .kpis import compute_kpis as compute_kpis
from .kpis import performance_index as performance_index
from .scenario import cstr as cstr
from .scenario import make_tuning_env as make_tuning_env
from .scenario import make_tuning_vector as make_tuning_vector
