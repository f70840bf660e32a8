"""The parameter files and examples are what the driver and the machine take."""

from __future__ import annotations

import configparser
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "config"


def test_the_driver_s_file_names_only_its_parameters_and_with_its_defaults():
    pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")
    yaml = pytest.importorskip("yaml")
    from stateful_ahrs.nodes.imu_driver import PARAMETERS

    content = yaml.safe_load((CONFIG / "imu_driver.yaml").read_text())
    values = content["/**/imu_driver"]["ros__parameters"]
    defaults = {spec.name: spec.default for spec in PARAMETERS}
    assert values == {name: defaults[name] for name in values}


def test_each_udev_rule_is_a_line_of_matches_and_assignments():
    term = r'[A-Z]+(\{\w+\})?(==|\+=|=)"[^"]*"'
    for line in (CONFIG / "60-stateful-ahrs.rules").read_text().splitlines():
        if line and not line.startswith("#"):
            assert re.fullmatch(rf"{term}(, {term})*", line), line


def test_the_service_restarts_and_ends_as_the_nodes_want():
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment]
    unit.read(CONFIG / "stateful-ahrs.service")
    assert unit["Service"]["Restart"] == "on-failure"
    assert unit["Service"]["KillSignal"] == "SIGINT"
    assert "ros2 launch stateful_ahrs imu.launch.py" in unit["Service"]["ExecStart"]
