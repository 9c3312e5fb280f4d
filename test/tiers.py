"""Cases of a law, of which a tenth is tried every day."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import Any

import pytest
from _pytest.mark import ParameterSet

SEED = 20261123


def a_tenth_every_day(cases: Mapping[str, Any]) -> list[ParameterSet]:
    """Make the parameters of a test: all in CI and at night, every day a tenth by a fixed seed.

    A case that is a tuple has a value for each argument.
    """
    everyday = random.Random(SEED).sample(sorted(cases), math.ceil(len(cases) / 10))
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            id=name,
            marks=[] if name in everyday else [pytest.mark.ci],
        )
        for name, case in cases.items()
    ]
