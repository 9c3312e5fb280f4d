"""Plans in a second engine, Drake, beside MuJoCo; skipped where Drake is not installed."""

import pytest

from ff_planner_benchmark import dataset
from ff_planner_benchmark.flown import flown_rows

pytestmark = pytest.mark.ci

pytest.importorskip("pydrake", reason="pip install './benchmark[drake]' brings Drake")
pytest.importorskip("mujoco")

LARGEST_MISS = 1.0  # [mm]


def test_three_plans_of_each_class_arrive_in_both_engines(tmp_path, times):
    each = times(1, 3)
    dataset.write_dataset(tmp_path / "set", 0, each)
    for kind, plans, in_mujoco, _, in_drake, _ in flown_rows(tmp_path / "set", each):
        assert int(plans) == each, kind
        assert float(in_mujoco) < LARGEST_MISS, kind
        assert float(in_drake) < LARGEST_MISS, kind
