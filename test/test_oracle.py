"""The golden numbers of the paper's equations are what the equations give."""

from __future__ import annotations

import json

import pytest
from oracle import FILE, golden, integrations
from test_forward import off


def test_every_golden_number_is_of_an_integration() -> None:
    assert json.loads(FILE.read_text("utf-8")).keys() == integrations().keys()


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize("name", list(integrations()))
def test_integrated_anew_a_system_ends_in_its_golden_numbers(name: str) -> None:
    assert off(integrations()[name](), golden(name)) < 3e-10, (
        f"{name}: is test/oracle.json of these equations?"
    )
