"""The files in examples/deploy are what the commands take."""

import configparser
import json
from pathlib import Path

import numpy as np
import pytest

from teamslam.cli.app import app
from teamslam.duty import read_duty
from teamslam.io.plain.lines import Lines
from teamslam.live import drive
from teamslam.robot import Robot

DEPLOY = Path(__file__).parents[1] / "examples" / "deploy"


def test_the_robot_can_be_told_its_duty_and_its_rows() -> None:
    duty = read_duty(DEPLOY / "red.toml")
    assert duty.log is not None and duty.lines and duty.resume
    lines = Lines(duty.log, duty.robot)
    address = duty.address(lines.robot)
    assert address is not None and lines.robot in address.members and address.listen.endswith(":7447")
    assert set(lines.head.robots) == set(address.members)
    rows = [{"file": "landmarks.csv", "stamp": 0.0, "landmark": "door", "range": 2.0, "bearing": 0.0}]
    for k in range(5):
        rows.append(
            {"file": "odometry.csv", "from_stamp": 0.1 * k, "to_stamp": 0.1 * (k + 1), "x": 0.1, "y": 0, "theta": 0}
        )
        rows.append(
            {
                "file": "landmarks.csv",
                "stamp": 0.1 * (k + 1),
                "landmark": "door",
                "range": 1.9 - 0.1 * k,
                "bearing": 0.0,
            }
        )
    arrivals = [[lines.row(json.dumps(row))] for row in rows]
    *_, last, end = drive(Robot.of(lines.head, lines.robot, duty.steps), arrivals, names=lambda: lines.names)
    assert last.now is not None
    np.testing.assert_allclose(last.now.pose.translation, [0.5, 0.0], atol=1e-9)
    assert [list(submap.names.landmarks.values()) for submap in end.submaps] == [["door"]]


def test_the_unit_starts_the_command_that_there_is() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment]
    unit.read(DEPLOY / "teamslam@.service")
    assert "teamslam robot --config /etc/teamslam/%i.toml" in unit["Service"]["ExecStart"]
    assert unit["Service"]["Restart"] == "always" and unit["Service"]["KillSignal"] == "SIGTERM"


def test_the_compose_file_gives_options_that_there_are() -> None:
    yaml = pytest.importorskip("ruamel.yaml")
    services = yaml.YAML(typ="safe").load(DEPLOY / "compose.yaml")["services"]
    for name, service in services.items():
        command, bound, _ = app.parse_args(service["command"].split(), exit_on_error=False, print_error=False)
        assert command.__name__ == "robot" and f"robot-{bound.kwargs['robot']}" == name
        assert bound.kwargs["members"] == (1, 2, 3) and bound.kwargs["listen"] == "0.0.0.0:7447"
