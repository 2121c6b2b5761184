"""Figures are drawn in the style of the house."""

from collections.abc import Iterator

import pytest

from prefcal_scenarios.presentation.style import style


@pytest.fixture(autouse=True)
def house_style() -> Iterator[None]:
    with style():
        yield
