"""A recorder's arguments are kept unchanged, and its run metadata comes from the run's folder."""

import json
import re
import subprocess
from dataclasses import replace
from datetime import UTC, datetime
from math import inf
from pathlib import Path

from obk_cli.emit.json import emit_plan
from obk_cli.plan.plan import Endpoint, Plan, PlannedSensorGroup
from obk_cli.record.recorder_job import (
    RecorderJob,
    RecordRequest,
    RunMetadata,
    file_name,
    job_from_json,
    job_to_json,
    run_metadata_of,
)
from obk_cli.runs.folder import plan_of_run, topics_of_run

from ..plans import node  # noqa: TID252 - shared by folders of tests

PROCESS = {
    "node": "n",
    "namespace": "/",
    "section": "robot",
    "device": "",
    "package": "p",
    "executable": "e",
    "origin": {"path": "c.yaml", "line": 1, "column": 1},
}
PLAN = {
    "name": "arm",
    "processes": [
        {
            **PROCESS,
            "publishes": [{"topic": "/a", "msg_type": None}],
            "subscribes": [{"topic": "/b", "msg_type": "x/msg/B"}],
        },
        {**PROCESS, "publishes": [], "subscribes": [{"topic": "/a", "msg_type": "x/msg/A"}]},
    ],
}


def run_folder(parent: Path) -> Path:
    folder = parent / "arm_20260102_030405"
    (folder / "params").mkdir(parents=True)
    (folder / "params" / "control_0.yaml").write_text("/**: {}\n", encoding="utf-8")
    run = {"name": "arm", "domain": 7, "plan_sha256": "ab", "versions": {"obk": "1"}, "plan": PLAN}
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    return folder


def test_a_job_round_trips_through_json() -> None:
    job = RecorderJob(
        path=Path("/runs/x.mcap"),
        request=RecordRequest(
            topics={"/a": None, "/b": "x/msg/B"}, patterns=("*",), excludes=("/c",)
        ),
        metadata={"obelisk": {"run": "x"}},
        attachments={"plan.json": "{}"},
        duration_s=2.5,
    )
    assert job_from_json(job_to_json(job)) == job


def test_a_run_reports_its_config_hash_versions_and_parameters(tmp_path: Path) -> None:
    background = run_metadata_of(run_folder(tmp_path))
    assert background.metadata == {
        "obelisk": {
            "run": "arm_20260102_030405",
            "name": "arm",
            "domain": "7",
            "plan_sha256": "ab",
        },
        "obelisk_versions": {"obk": "1"},
    }
    assert json.loads(background.attachments["plan.json"]) == PLAN
    assert background.attachments["params/control_0.yaml"] == "/**: {}\n"


def test_the_topics_of_a_run_have_the_types_that_either_end_knows(tmp_path: Path) -> None:
    assert topics_of_run(run_folder(tmp_path)) == {"/a": "x/msg/A", "/b": "x/msg/B"}


def test_the_plan_of_a_run_is_read_back(tmp_path: Path) -> None:
    robot = node(
        "robot",
        "robot",
        parameters={"realtime_factor": 0.5, "use_sim_time": True},
        publishes=(Endpoint(topic="/q", msg_type="x/msg/Q", rate_hz=100.0),),
        model="arm.xml",
        sensor_groups=(PlannedSensorGroup(topic="/q", kind="Q", sensors={"j": "jointpos"}),),
    )
    every = replace(robot, parameters={**robot.parameters, "bounds": (0.0, inf)}, env={"A": "1"})
    plan = Plan(name="arm", nodes=(every,))
    record = {"plan": json.loads(emit_plan(plan))}
    (tmp_path / "run.json").write_text(json.dumps(record), encoding="utf-8")
    kept = replace(every, parameters={**robot.parameters, "bounds": (0.0, ".inf")})
    assert plan_of_run(tmp_path) == Plan(name="arm", nodes=(kept,))


def test_a_folder_without_a_run_reports_nothing(tmp_path: Path) -> None:
    assert topics_of_run(tmp_path) == {}
    assert plan_of_run(tmp_path).nodes == ()
    assert run_metadata_of(tmp_path) == RunMetadata(
        metadata={"obelisk": {"run": tmp_path.name}, "obelisk_versions": {}}
    )


def test_a_file_is_named_after_the_config_of_its_run() -> None:
    when = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)
    assert file_name(None, when) == "ros_20260304_050607.mcap"
    for run in ("leg_arm_20260102_030405", "leg_arm_20260102_030405_2"):
        assert file_name(Path("/runs", run), when) == "leg_arm_20260304_050607.mcap"


def test_the_commit_of_the_workspace_is_named(tmp_path: Path) -> None:
    workspace, folder = tmp_path / "ws", tmp_path / "arm_20260301_120000"
    workspace.mkdir()
    folder.mkdir()
    config = workspace / "arm.yaml"
    config.write_text("config: arm\n")
    (folder / "run.json").write_text(json.dumps({"name": "arm", "config": str(config)}))
    assert "obelisk_code" not in run_metadata_of(folder).metadata
    identity = ("-c", "user.name=a", "-c", "user.email=a@b")
    for words in (("init", "-q"), ("add", "."), (*identity, "commit", "-qm", "first")):
        subprocess.run(["git", *words], cwd=workspace, check=True)
    commit = run_metadata_of(folder).metadata["obelisk_code"]["commit"]
    assert re.fullmatch("[0-9a-f]{12}", commit)
    config.write_text("config: leg\n")
    assert run_metadata_of(folder).metadata["obelisk_code"]["commit"] == f"{commit}-dirty"
