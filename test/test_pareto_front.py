"""The trade between joint path and chaser attitude."""

import json

import pytest
from robots import LEMUR_SCENARIO

from ff_planner_ros.cli import main


@pytest.mark.nightly
def test_the_pareto_front_is_drawn_and_its_weights_give_its_plans_again(tmp_path, capsys):
    told, again = tmp_path / "front.json", tmp_path / "again.json"
    command = ["plan", str(LEMUR_SCENARIO)]
    assert main([*command, "--pareto", "--json", str(told), "--output", str(tmp_path)]) == 0
    assert (tmp_path / "pareto_front.png").read_bytes().startswith(b"\x89PNG")
    rows = json.loads(told.read_text())["pareto_front"]
    trades = [(r["metrics"]["joint_path_length"], r["metrics"]["max_chaser_euler"]) for r in rows]
    assert len(rows) >= 4
    assert trades == sorted(trades), "the joint path grows"
    assert [angle for _, angle in trades] == sorted((angle for _, angle in trades), reverse=True)
    # Joint splines of a little weight may be shorter than the shortest of the paper's paths.
    assert rows[0]["objective"]["joint_path_length"] == 1.0
    assert rows[0]["objective"]["chaser_attitude"] <= 2.0
    # The table names what makes a plan again, to the last bit.
    shown = capsys.readouterr().out
    chosen = rows[2]
    weights = ",".join(f"{weight:g}" for weight in chosen["objective"].values())
    assert f"\n{weights} " in shown
    assert main([*command, "--objective", weights, "--json", str(again)]) == 0
    made = json.loads(again.read_text())
    assert made["coefficients"] == chosen["coefficients"]
    assert made["digest"] == chosen["digest"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--pareto", "--objective", "length"], "--objective"),
        (["--pareto", "--method", "apf"], "--method"),
        (["--objective", "1;2"], "two weights such as 1,10"),
        (["--objective", "-1,2"], "must not be negative"),
        (["--objective", "0,0"], "one weight must be positive"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, complaint, capsys):
    # With "=", so that a value may begin with a minus.
    options = [f"{options[-2]}={options[-1]}", *options[:-2]]
    assert main(["plan", str(LEMUR_SCENARIO), *options]) == 2
    assert complaint in capsys.readouterr().err
