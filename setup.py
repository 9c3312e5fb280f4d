"""Build of the ROS package `ff_planner_ros`, by colcon or pip."""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "ff_planner_ros"
VERSION = ElementTree.parse("package.xml").findtext("version")


def installed_as_they_are(*trees: str) -> list[tuple[str, list[str]]]:
    """List the files of whole directories for share/ff_planner_ros."""
    files = [path for tree in trees for path in sorted(Path(tree).rglob("*")) if path.is_file()]
    return [(f"share/{NAME}/{path.parent}", [str(path)]) for path in files]


# The node, its demonstration and what reads messages by their types. The messages are no package of
# an index: `pip install ./msg_defs '.[ros]'`.
ROS = [
    f"ff_planner_msgs=={VERSION}",
    "ros-jazzy-common-interfaces>=5.3,<5.4",
    "ros-jazzy-rclpy[fastrtps]>=7.1,<7.2",
]
SIMULATION = ["mujoco-core>=4,<5"]  # without it, everything runs but `ff-planner verify`

setup(
    name=NAME,
    version=VERSION,
    description="Trajectory planning service for free-floating space manipulators.",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.runs": ["*.css", "*.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *installed_as_they_are("config", "examples", "launch"),
    ],
    zip_safe=False,
    # A reason for each is in README.md; what package.xml names is the same list in ROS's words.
    install_requires=[
        "lz4>=4.3,<5",
        "matplotlib>=3.8,<4",
        "mcap>=1.6,<2",
        "numpy>=1.26,<3",
        "pin>=4.1,<5",
        "piqp>=0.6,<0.7",
        "plotly>=5.18,<8",
        "pyyaml>=6,<7",
        "rosbags>=0.11.9,<0.12",
        "scipy>=1.11,<2",
        "zstandard>=0.22,<1",
    ],
    extras_require={
        "ros": ROS,
        "simulation": SIMULATION,
        # 131 MB that only tests read: the URDFs, as found, of arms and robots that others made.
        "robots": ["example-robot-data>=6,<7"],
        "test": [
            *ROS,
            *SIMULATION,
            "colcon-defaults>=0.2,<0.3",
            "colcon-ros>=0.5,<0.6",
            "cyclonedds>=11,<12",
            "mcap-ros2-support>=0.6,<0.7",
            "mypy>=2.4,<3",
            "pytest>=9,<10",
            "pytest-cov>=7,<8",
            "pytest-xdist>=3.8,<4",
            "ruff>=0.17,<0.18",
            "types-PyYAML>=6,<7",
        ],
    },
    entry_points={
        "console_scripts": [
            f"ff-planner = {NAME}.cli:main",
            f"planner_node = {NAME}.ros.node:main",
        ],
    },
)
