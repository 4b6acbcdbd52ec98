"""Commands that inspect a stack, without ROS: misuse, domains, completion."""

import json
from datetime import datetime
from pathlib import Path

import pytest

from obk_cli.cli.complete import complete_nodes, complete_topics
from obk_cli.cli.main import main
from obk_cli.cli.topic_pub import _split_arguments
from obk_cli.introspect.target import target_of
from obk_cli.monitor.stack_follower import StackSelector
from obk_cli.process.identity import this_process
from obk_cli.ros.environment import RosEnvironment
from obk_cli.runs.folder import Run, RunOrigin, make_run_folder, write_run

PLAN = {
    "name": "arm",
    "processes": [
        {
            "node": "estimator",
            "namespace": "/arm",
            "section": "estimation",
            "device": "onboard",
            "package": "arm_py",
            "executable": "estimator",
            "origin": {"path": "arm.yaml", "line": 1, "column": 1},
            "publishes": [{"topic": "/arm/est", "msg_type": "pkg/msg/State"}],
            "subscribes": [{"topic": "/arm/imu", "msg_type": None}],
        }
    ],
}


def runs_in(home: Path, **domains: int) -> None:
    """Live runs by name, all of this process."""
    pid, started = this_process()
    for name, domain in domains.items():
        folder = make_run_folder(home / "runs", name, datetime(2031, 2, 3, 4, 5, 6))
        run = Run(
            name=name,
            pid=pid,
            started=started,
            domain=domain,
            config=f"{name}.yaml",
            nodes=("/obelisk_robot_0",),
            other_nodes=("/joy",),
        )
        write_run(folder, run, RunOrigin(plan=json.dumps(PLAN), versions={}))


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("OBK_HOME", str(tmp_path))
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    return tmp_path


def environment(home: Path, **variables: str) -> RosEnvironment:
    return RosEnvironment(
        variables={"OBK_HOME": str(home), **variables}, range="LOCALHOST", notes=()
    )


def test_the_domain_of_all_running_stacks_is_inspected(home: Path) -> None:
    runs_in(home, arm=7, leg=7)
    graph_target = target_of(environment(home), None)
    assert graph_target.domain == 7
    assert graph_target.nodes == ("/obelisk_robot_0", "/joy") * 2
    assert graph_target.topics == {"/arm/est": "pkg/msg/State", "/arm/imu": None}


def test_a_named_or_set_domain_comes_first(home: Path) -> None:
    runs_in(home, arm=7)
    assert target_of(environment(home, ROS_DOMAIN_ID="3"), None).domain == 3
    assert target_of(environment(home, ROS_DOMAIN_ID="3"), 7).nodes
    assert not target_of(environment(home), 4).nodes


def test_stacks_in_several_domains_leave_it_to_the_user(home: Path) -> None:
    runs_in(home, arm=7, leg=8)
    graph_target = target_of(environment(home), None)
    assert graph_target.domain == 0
    no_nodes_error = graph_target.no_nodes_error()
    assert no_nodes_error.message.startswith("no stack is running in ROS domain 0")
    assert no_nodes_error.help is not None
    assert {"arm in 7", "leg in 8"} <= set(
        no_nodes_error.help.removeprefix("running in other domains: ").partition(";")[0].split(", ")
    )


def test_stacks_with_undiscovered_nodes_are_not_reported_as_stopped(home: Path) -> None:
    runs_in(home, arm=7, leg=7)
    no_nodes_error = target_of(environment(home), None).no_nodes_error()
    assert (
        no_nodes_error.message == "none of the nodes of arm, leg was found in ROS domain 7 in time"
    )


def test_a_stack_to_watch_that_does_not_run_is_reported_with_those_that_do(home: Path) -> None:
    runs_in(home, arm=7)
    no_nodes_error = StackSelector(
        environment=environment(home), domain=7, run="amr"
    ).no_nodes_error()
    assert no_nodes_error.message == "no stack `amr` is running in ROS domain 7"
    assert no_nodes_error.help == "did you mean `arm`?"
    elsewhere = StackSelector(environment=environment(home), domain=8, run="arm").no_nodes_error()
    assert elsewhere.message.startswith("no stack is running in ROS domain 8")


def test_names_are_completed_from_the_plans(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs_in(home, arm=7)
    assert complete_topics("") == ["/arm/est", "/arm/imu"]
    assert complete_topics("/arm/i") == ["/arm/imu"]
    assert complete_topics("e") == ["est"]
    assert complete_nodes("r") == ["robot_0"]
    assert complete_nodes("/") == ["/joy", "/obelisk_robot_0"]
    monkeypatch.setenv("ROS_DOMAIN_ID", "8")
    assert complete_topics("") == []


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("topic list --timeout 0", "`--timeout 0`: expected a number of seconds above 0"),
        ("topic list --timeout inf", "`--timeout inf`: expected a number of seconds up to 1000000"),
        ("topic list --wait -1", "`--wait -1`: expected a number of seconds above 0"),
        ("node list --wait nan", "`--wait nan`: expected a number of seconds above 0"),
        (
            "monitor --once --period 1e300",
            "`--period 1e+300`: expected a number of seconds up to 1000000",
        ),
        ("topic list --format yaml", "`--format yaml`: expected `text` or `json`"),
        ("topic echo est --format yaml", "expected `text`, `json` or `csv`"),
        ("topic echo est --csv --format json", "`--csv` and `--format json` cannot be combined"),
        (
            "service call a/b --type Trigger",
            "`--type Trigger`: expected a type such as `std_srvs/srv/",
        ),
        ("topic echo est a..b", "`a..b` does not name a field"),
        ("topic hz est --window 0", "`--window 0`: expected a number of seconds above 0"),
        ("topic hz est --duration -1", "`--duration -1`: expected a number of seconds above 0"),
        ("topic pub est pkg/msg/State {} {}", "unexpected argument `{}`"),
        ("topic pub est PositionSetpiont {}", "did you mean `PositionSetpoint`"),
        ("topic pub est --rate 0", "`--rate 0`: expected a number above 0"),
        ("param set arm gain [1,a]", "`[1,a]` is not a valid parameter value"),
        ("param set arm gain [", "`[` is not valid YAML"),
    ],
)
def test_an_invalid_command_is_reported_before_ros_is_loaded(
    words: str, complaint: str, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(words.split())
    assert end.value.code == 2
    assert complaint in capsys.readouterr().err


def test_the_modules_of_a_topics_type_are_known_from_the_plan(home: Path) -> None:
    runs_in(home, arm=7)
    graph_target = target_of(environment(home), None)
    assert graph_target.modules(["est", "imu", "other"]) == ("rosidl_generator_py", "pkg.msg")


@pytest.mark.parametrize(
    ("words", "msg_type", "text"),
    [
        ("", None, ""),
        ("{u_mujoco:1}", None, "{u_mujoco:1}"),
        ("PositionSetpoint", "obelisk_control_msgs/msg/PositionSetpoint", ""),
        ("my_msgs/Example {}", "my_msgs/msg/Example", "{}"),
        ("std_msgs/msg/Float64 {}", "std_msgs/msg/Float64", "{}"),
    ],
)
def test_a_type_to_publish_is_written_as_in_a_config(
    words: str, msg_type: str | None, text: str
) -> None:
    assert _split_arguments(words.split()) == (msg_type, text)
