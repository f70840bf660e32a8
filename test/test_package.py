"""What the package says of itself agrees with itself, and the rooms keep their order."""

import ast
import importlib
import os
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import pytest

import stateful_ahrs

ROOT = Path(__file__).parents[1]
SOURCES = sorted(ROOT.glob("stateful_ahrs/**/*.py"))
ROOMS = ("rotor", "snapshot", "filters", "mpu9250", "recordings", "evaluation", "nodes")
FOR_ALL = ("command", "errors", "words", "__init__", "__version__")

PIP_ONLY = {"distributed", "numba", "rosbags"}  # optional; package.xml says why
ROS_ONLY = {"launch", "launch_pytest", "launch_ros", "ros2launch", "tf2_ros_py"}  # no wheels
WHEELS_ONLY = {"rmw_fastrtps_cpp"}  # ROS brings a middleware of its own
REQUIREMENT_KEYS = {"pyserial": "python3-serial", "pyyaml": "python3-yaml"}
MODULE_KEYS = {"tf2_ros": "tf2_ros_py"}


def setup_arguments() -> dict[str, Any]:
    """What setup.py hands to setuptools."""
    arguments: dict[str, Any] = {}
    setuptools = ModuleType("setuptools")
    vars(setuptools).update(setup=arguments.update, find_packages=lambda **_: [])
    with patch.dict(sys.modules, setuptools=setuptools), pytest.MonkeyPatch.context() as patched:
        patched.chdir(ROOT)
        runpy.run_path("setup.py")
    return arguments


SETUP = setup_arguments()
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()
EXECUTABLES = [entry.split(" = ") for entry in SETUP["entry_points"]["console_scripts"]]


def keys(requirements: list[str]) -> set[str]:
    """The rosdep keys of pip requirements, without what only one of the two has."""
    names = {re.match(r"[\w.-]+", requirement)[0].lower() for requirement in requirements}
    ros = {name[10:].replace("-", "_") for name in names if name.startswith("ros-jazzy-")}
    plain = {name for name in names if not name.startswith("ros-jazzy-")} - PIP_ONLY
    return (ros - WHEELS_ONLY) | {REQUIREMENT_KEYS.get(name, f"python3-{name}") for name in plain}


def depends(kind: str) -> set[str]:
    return {element.text for element in MANIFEST.findall(kind)}


def imports(file: Path) -> Iterator[str]:
    """Everything that a file imports, as full dotted names, also inside functions."""
    package = file.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else ()
            where = [*base, *filter(None, [node.module])]
            yield from (".".join([*where, alias.name]) for alias in node.names)


def foreign_imports(files: list[Path]) -> set[str]:
    """The top-level modules that are neither ours nor Python's."""
    found = {name.partition(".")[0] for file in files for name in imports(file)}
    return found - {"stateful_ahrs"} - sys.stdlib_module_names


def test_one_version_everywhere():
    assert SETUP["version"] == MANIFEST.findtext("version") == stateful_ahrs.__version__


def test_package_xml_is_what_colcon_takes_for_ament_python():
    assert MANIFEST.get("format") == "3"
    assert MANIFEST.findtext("export/build_type") == "ament_python"
    # With an address that is none, colcon silently builds a plain Python package.
    assert re.fullmatch(r"[\w.+-]+@[\w-]+(\.[\w-]+)+", MANIFEST.find("maintainer").get("email"))


def test_name_licence_and_maintainer_agree():
    maintainer = MANIFEST.find("maintainer")
    assert SETUP["name"] == MANIFEST.findtext("name")
    assert SETUP["license"] == MANIFEST.findtext("license") == "Apache-2.0"
    assert SETUP["maintainer"] == maintainer.text
    assert SETUP["maintainer_email"] == maintainer.get("email")


def test_pip_and_rosdep_install_the_same():
    extras = dict(SETUP["extras_require"])
    del extras["lint"], extras["bench"]
    assert keys(extras.pop("test")) == depends("test_depend") - ROS_ONLY
    run = [*SETUP["install_requires"], *(need for needs in extras.values() for need in needs)]
    assert keys(run) == depends("exec_depend") - ROS_ONLY


def test_what_is_imported_is_declared_and_what_is_declared_is_imported():
    declared = depends("exec_depend") | PIP_ONLY
    used = foreign_imports([*SOURCES, *ROOT.glob("launch/*.py")])
    python = {name: f"python3-{name}" for name in used if f"python3-{name}" in declared}
    assert {(python | MODULE_KEYS).get(name, name) for name in used} == declared - {"ros2launch"}


@pytest.mark.parametrize(("name", "target"), EXECUTABLES)
def test_every_executable_can_be_imported(name: str, target: str):
    module, _, function = target.partition(":")
    assert callable(getattr(importlib.import_module(module), function)), name


def test_setup_installs_every_launch_and_parameter_file():
    installed = {name for _, names in SETUP["data_files"] for name in names}
    files = [file for folder in ("launch", "config") for file in (ROOT / folder).iterdir()]
    assert {str(file.relative_to(ROOT)) for file in files if file.is_file()} <= installed


def test_every_folder_with_code_is_a_package():
    assert [file for file in SOURCES if not (file.parent / "__init__.py").exists()] == []


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(ROOT)))
def test_a_room_imports_only_rooms_before_it(file: Path):
    room = file.relative_to(ROOT / "stateful_ahrs").parts[0].removesuffix(".py")
    seen = {name.split(".")[1] for name in imports(file) if name.startswith("stateful_ahrs.")}
    before = ROOMS[: ROOMS.index(room) + 1] if room in ROOMS else ()
    assert seen <= {*before, *FOR_ALL}


def test_only_nodes_speak_to_ros():
    elsewhere = [file for file in SOURCES if "nodes" not in file.parts]
    ros = {name for name in depends("exec_depend") if not name.startswith("python3-")}
    assert foreign_imports(elsewhere).isdisjoint(ros | {"tf2_ros"})


def test_no_tracked_file_names_a_path_of_someones_machine():
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True)
    if tracked.returncode:
        pytest.skip("not a git checkout")
    personal = re.compile(rb"(?<![\w./-])/(?:home|root|work|Users)/\w")
    files = [ROOT / name for name in tracked.stdout.decode().split("\0") if name]
    assert [file for file in files if file.is_file() and personal.search(file.read_bytes())] == []


def test_the_parameter_file_for_fusion_repeats_its_defaults():
    pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")
    from stateful_ahrs.nodes.fusion import PARAMETERS

    text = (ROOT / "config" / "fusion.yaml").read_text()
    given = dict(re.findall(r"^    (\w+): (\S+)", text, re.MULTILINE))
    defaults = {spec.name: str(spec.default) for spec in PARAMETERS}
    assert {
        name: value.replace("true", "True").replace("false", "False").strip('"')
        for name, value in given.items()
    }.items() <= defaults.items()


def test_ros2_launch_finds_every_launch_file():
    """It walks the share of the package, and follows no link to a folder."""
    prefixes = map(Path, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    shares = [prefix / "share/stateful_ahrs" for prefix in prefixes]
    share = next(filter(Path.is_dir, shares), None)
    if share is None:
        pytest.skip("the package is in no prefix of ROS's: make setup, or colcon build, makes one")
    found = {name for _, _, names in os.walk(share) for name in names}
    assert {path.name for path in ROOT.glob("launch/*.py")} <= found
