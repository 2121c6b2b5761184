"""The room of the continuous stirred tank reactor, section IV-A."""

from prefcal_scenarios.cstr.indicators import indicators as indicators
from prefcal_scenarios.cstr.indicators import performance_index as performance_index
from prefcal_scenarios.cstr.room import cstr as cstr
from prefcal_scenarios.cstr.room import make_tuning_env as make_tuning_env
from prefcal_scenarios.cstr.room import make_tuning_vector as make_tuning_vector
