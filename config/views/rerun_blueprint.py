"""Write the blueprint for a bag of the planner in Rerun, whose blueprints fit one version only.

Rerun shows a file by a blueprint that is made for the file's name.

pip install rerun-sdk
python rerun_blueprint.py BAG.mcap planner.rbl
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
                rrb.TextLogView(name="Log", origin="/rosout"),
            ),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )


if __name__ == "__main__":
    bag, made = map(Path, sys.argv[1:])
    blueprint().save(bag.stem, str(made))
