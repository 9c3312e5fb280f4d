"""Small studies that tests of campaigns share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from quick_capture import quick_capture

from ff_planner_ros.campaign.study import Study, load_study


def study_file(directory: Path, **changes: Any) -> Path:
    """Write a study of twelve plans that take hundredths of a second each."""
    directory.mkdir(exist_ok=True)
    study = {
        "scenarios": [quick_capture(directory).name],
        "variations": {
            "grid": {"duration": [2.0, 2.5]},
            "random": {
                "count": 3,
                "seed": 7,
                "values": {
                    "urdf.chaser.mass": {"times": {"uniform": [0.9, 1.1]}},
                    "chaser.angular_velocity": {"plus": {"normal": [0.0, 0.002]}},
                },
            },
        },
        "methods": [{"name": "ours"}, {"name": "straight", "method": "straight"}],
    }
    path = directory / "study.yaml"
    path.write_text(yaml.safe_dump(study | changes), encoding="utf-8")
    return path


def study(directory: Path, **changes: Any) -> Study:
    """Return such a study."""
    return load_study(study_file(directory, **changes))
