"""Build of the ROS package `ff_planner_ros`, by colcon or pip."""

import hashlib
import importlib.metadata
import os
import shutil
import subprocess
import sysconfig
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

NAME = "ff_planner_ros"
CORE = f"{NAME}/core"
VERSION = ElementTree.parse("package.xml").findtext("version")


def installed_as_they_are(*trees: str) -> list[tuple[str, list[str]]]:
    """List the files of whole directories for share/ff_planner_ros."""
    files = [path for tree in trees for path in sorted(Path(tree).rglob("*")) if path.is_file()]
    return [(f"share/{NAME}/{path.parent}", [str(path)]) for path in files]


class BuildCore(build_ext):
    """Builds the core, and says in words what the machine lacks for it."""

    user_options = [  # noqa: RUF012  # as setuptools reads it
        *build_ext.user_options,
        ("sanitize", None, "stop at every access out of bounds and all undefined behaviour"),
    ]
    boolean_options = [*build_ext.boolean_options, "sanitize"]  # noqa: RUF012

    def initialize_options(self) -> None:
        """Sanitize only where it is asked for."""
        super().initialize_options()
        self.sanitize = False

    def build_extensions(self) -> None:
        """Build, if the machine can."""
        compiler = self.compiler.compiler_cxx[0]
        headers = Path(sysconfig.get_path("include"), "Python.h")
        if shutil.which(compiler) is None or not headers.is_file():
            raise SystemExit(
                f"{NAME} is partly written in C++: to install it, a C++ compiler ({compiler}) and "
                f"the headers of Python ({headers}) are needed (Debian: g++ python3-dev)"
            )
        super().build_extensions()

    def build_extension(self, ext: Extension) -> None:
        """Build, or take what the tree has in place if it is built of the same sources."""
        built = Path(self.get_ext_fullpath(ext.name))
        built.parent.mkdir(parents=True, exist_ok=True)
        in_place = Path(self.get_ext_filename(self.get_ext_fullname(ext.name)))
        # By which `ff-planner doctor`, too, knows what the core is built of.
        digest = digest_of(*ext.sources, *ext.depends)
        if not self.sanitize and in_place.is_file() and digest.encode() in in_place.read_bytes():
            if built.resolve() != in_place.resolve():
                shutil.copy2(in_place, built)
            return
        with_digest = Path(self.build_temp, "sources_digest.cpp")
        write(with_digest, f'extern const char kSourcesDigest[] = "{digest}";\n')
        sanitizers = SANITIZERS if self.sanitize else []
        self.compiler.link_shared_object(
            self.compiled([*map(Path, ext.sources), with_digest], sanitizers),
            str(built),
            extra_postargs=["-pthread", *sanitizers],
            target_lang="c++",
        )

    def compiled(self, sources: Sequence[Path], sanitizers: Sequence[str]) -> list[str]:
        """Return the objects of sources; on all processors, compile those that have changed."""
        compiler = getattr(self.compiler, "compiler_so_cxx", self.compiler.compiler_so)
        system = [pybind11_headers(), eigen_headers(), *self.compiler.include_dirs]
        command = [*compiler, *FLAGS, f"-I{CORE}"]
        command += [part for directory in system for part in ("-isystem", directory)]
        commands, headers = {}, {}
        for directory, (header, optimised) in DIRECTORIES.items():
            commands[directory] = [*command, optimised, *sanitizers]
            headers[directory] = Path(self.build_temp, "precompiled", header)
            text = f'// {" ".join(commands[directory])}\n#include "{header}"\n'
            write(headers[directory], text)  # another command is another header

        def precompiled(directory: str) -> str:
            header = headers[directory]
            options = ["-x", "c++-header"]
            return up_to_date([*commands[directory], *options], [header], Path(f"{header}.gch"))

        def compiled(source: Path) -> str:
            directory = source.parent.name if source.parent.name in headers else ""
            header = headers[directory]
            options = ["-include", str(header), "-c"]
            target = Path(self.build_temp, *source.with_suffix(".o").parts[-2:])
            made_of = [source, Path(f"{header}.gch")]
            return up_to_date([*commands[directory], *options], made_of, target)

        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as compilers:
            list(compilers.map(precompiled, headers))
            return list(compilers.map(compiled, sources))


def up_to_date(command: Sequence[str], made_of: Sequence[Path], target: Path) -> str:
    """Compile a source, the first of these, unless the target is newer than all it is made of."""
    includes = Path(f"{target}.d")  # a rule for make; the compiler writes it
    if includes.is_file():
        included = includes.read_text(encoding="utf-8").replace("\\\n", "").split()[1:]
        if is_newer(target, [*made_of, *included]):
            return str(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    files = ["-MD", "-MF", str(includes), str(made_of[0]), "-o", str(target)]
    subprocess.run([*command, *files], check=True)
    return str(target)


def is_newer(target: Path, made_of: Iterable[str | Path]) -> bool:
    """Return whether a file is newer than all files that it is made of."""
    try:
        changed = max(Path(file).stat().st_mtime for file in made_of)
        return target.stat().st_mtime >= changed
    except FileNotFoundError:
        return False


def write(file: Path, text: str) -> None:
    """Write a file, unless it is so already: what is made of it need not be made anew then."""
    if not file.is_file() or file.read_text(encoding="utf-8") != text:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")


def digest_of(*files: str) -> str:
    """Return the digest of sources, as commands/doctor.py takes it."""
    contents = b"".join(path.read_bytes() for path in sorted(map(Path, files)))
    return hashlib.sha256(contents).hexdigest()


def pybind11_headers() -> str:
    """Return where pybind11's headers are: pip's, else the system's."""
    try:
        import pybind11  # only a build has it
    except ModuleNotFoundError:
        return system_headers("pybind11/pybind11.h", "pybind11", "pybind11-dev")
    return str(pybind11.get_include())


def eigen_headers() -> str:
    """Return where Eigen's headers are: pip's, else the system's."""
    try:
        eigen = importlib.metadata.distribution("cmeel-eigen")
    except importlib.metadata.PackageNotFoundError:
        return system_headers("eigen3/Eigen/Core", "cmeel-eigen", "libeigen3-dev") + "/eigen3"
    return str(eigen.locate_file("cmeel.prefix/include/eigen3"))


def system_headers(header: str, of_pip: str, of_debian: str) -> str:
    """Return the directory in which the system has a header."""
    for place in ("/usr/include", "/usr/local/include"):
        if Path(place, header).is_file():
            return place
    raise SystemExit(
        f"to build {NAME}, {header} is needed: pip install {of_pip} (Debian: {of_debian})"
    )


# What every file of a directory includes, compiled once for all, and how it is optimised; "": of
# the other directories. Bindings alone need Python's headers, which take longer than all that the
# numerics include; they only hand over what the numerics compute.
DIRECTORIES = {"": ("kinematics/chain.hpp", "-O3"), "bindings": ("bindings/arrays.hpp", "-O1")}

# The same results on every machine of one kind: no instructions that only some of them have, and
# sums in the order in which they are written.
FLAGS = ["-std=c++17", "-g0", "-DNDEBUG", "-ffp-contract=off", "-fvisibility=hidden"]
# gcc 12 suspects Eigen's small matrices, and its vectors in a precompiled header.
FLAGS += ["-Wno-maybe-uninitialized", "-Wno-ignored-attributes"]

# Eigen's own assertions stay, and nothing is inlined: it compiles in a minute, not in ten. Checks
# of addresses are calls for the same reason, and what they find needs no second check.
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize=null,alignment,object-size,vptr"]
SANITIZERS += ["-fno-sanitize-recover=all", "--param=asan-instrumentation-with-call-threshold=0"]
SANITIZERS += ["-fno-sanitize-address-use-after-scope", "-O0", "-UNDEBUG"]

# The node, its demonstration and what reads messages by their types. The messages are no package of
# an index: `pip install ./msg_defs '.[ros]'`.
ROS = [
    f"ff_planner_msgs=={VERSION}",
    "ros-jazzy-common-interfaces>=5.3,<5.4",
    "ros-jazzy-rclpy[fastrtps]>=7.1,<7.2",
]
SIMULATION = ["mujoco-core>=4,<5"]  # without it, everything runs but `ff-planner verify`
# Likewise, but `ff-planner campaign`, and pandas for who reads its tables.
CAMPAIGN = [
    "cryptography>=50,<51",
    "distributed>=2026.8,<2027",
    "pandas>=2.2,<4",
    "pyarrow>=26,<27",
]
CONSOLE = ["viser>=1.1,<2"]  # likewise, but `ff-planner console`

setup(
    name=NAME,
    version=VERSION,
    description="Trajectory planning service for free-floating space manipulators.",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="ff_planner_ros developers",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: ["py.typed"],
        f"{NAME}.core": ["*.pyi", "**/*.cpp", "**/*.hpp"],
        f"{NAME}.report": ["*.css", "*.js"],
    },
    ext_modules=[
        Extension(
            f"{NAME}.core.compiled",
            [str(path) for path in sorted(Path(CORE).rglob("*.cpp"))],
            depends=[str(path) for path in sorted(Path(CORE).rglob("*.hpp"))],
            language="c++",
        )
    ],
    cmdclass={"build_ext": BuildCore},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *installed_as_they_are("config", "examples", "launch"),
    ],
    zip_safe=False,
    # Why each: docs/reference/dependencies.md; package.xml names the same list in ROS's words.
    install_requires=[
        "lz4>=4.3,<5",
        "matplotlib>=3.8,<4",
        "mcap>=1.6,<2",
        "numpy>=1.26,<3",
        "pin>=4.1,<5",
        "plotly>=5.18,<8",
        "pyyaml>=6,<7",
        "rosbags>=0.11.9,<0.12",
        "scipy>=1.11,<2",
        "zstandard>=0.22,<1",
    ],
    extras_require={
        "ros": ROS,
        "simulation": SIMULATION,
        "campaign": CAMPAIGN,
        "console": CONSOLE,
        # 130 MB with which tests drive a browser that the machine has.
        "browser": ["playwright>=1.60,<2"],
        # 131 MB that only tests read: the URDFs, as found, of arms and robots that others made.
        "robots": ["example-robot-data>=6,<7"],
        # 88 MB, most of it astropy's, with which tests read what `export --oem` writes.
        "ccsds": ["oem>=0.4.5,<0.5"],
        # The site of `docs/`, for `make docs`.
        "docs": ["furo>=2025.9", "myst-parser>=5,<6", "sphinx>=9,<10"],
        # The build that a ROS machine does, for `make build`.
        "colcon": ["colcon-defaults>=0.2,<0.3", "colcon-ros>=0.5,<0.6"],
        "test": [
            *ROS,
            *SIMULATION,
            *CAMPAIGN,
            *CONSOLE,
            "clang-format>=23,<24",
            "cyclonedds>=11,<12",
            "jsonschema>=4.23,<5",
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
            f"planner_node = {NAME}.cli:planner_node",
        ],
    },
)
