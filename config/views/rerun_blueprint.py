"""Write the blueprint for a bag of the planner in Rerun, whose blueprints fit one version only.

pip install rerun-sdk
python rerun_blueprint.py planner.rbl
rerun BAG.mcap planner.rbl
"""

import sys
from pathlib import Path

import rerun.blueprint as rrb


def blueprint() -> rrb.Blueprint:
    """Return the scene in the inertial frame beside what changes with time."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                name="Plan and scene",
                origin="/",
                spatial_information=rrb.SpatialInformation(target_frame="inertial"),
            ),
            rrb.Vertical(
                rrb.TimeSeriesView(name="Measured from predicted chaser", origin="/tracking_error"),
                rrb.TimeSeriesView(name="Preview of the joints", origin="/planned_joint_states"),
                rrb.TimeSeriesView(name="What becomes of plans", origin="/plan_events"),
                rrb.TextLogView(name="Log", origin="/rosout"),
            ),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )


if __name__ == "__main__":
    blueprint().save("ff_planner", str(Path(sys.argv[1])))
