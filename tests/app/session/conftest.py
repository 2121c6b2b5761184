"""The toy, for the tests of interviews about it."""

import pytest

from toy_study import toy_scenario


@pytest.fixture
def toy():
    return toy_scenario()
