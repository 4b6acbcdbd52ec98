"""Probes of fake folders and programs."""

import os
import sys
from pathlib import Path

import pytest

from obk_cli.doctor.child import child_command, json_output, try_program
from obk_cli.doctor.child_programs import load_error
from obk_cli.doctor.installation import probe_paths
from obk_cli.doctor.interfaces import probe_compiler
from obk_cli.doctor.machine import probe_cpu, probe_folders, probe_shared_memory, probe_transport
from obk_cli.doctor.mujoco import probe_display
from obk_cli.doctor.network import probe_discovery
from obk_cli.doctor.ros import probe_rmw
from obk_cli.doctor.workspace import probe_workspace
from obk_cli.errors import CommandFailedError


def program(code: str) -> tuple[str, ...]:
    return (sys.executable, "-c", code)


def test_a_program_that_crashes_is_reported_by_its_signal() -> None:
    trial = try_program(
        program("import os; print('first', flush=True); os.kill(os.getpid(), 11)"), timeout_s=20.0
    )
    assert (trial.end, trial.signal, trial.stdout) == ("crashed", "SIGSEGV", "first\n")


def test_a_program_that_fails_is_reported_with_its_last_output() -> None:
    trial = try_program(program("raise ValueError('so')"), timeout_s=20.0)
    assert trial.outcome == "failed: ValueError: so"


def test_a_hanging_program_is_killed_and_its_output_is_kept() -> None:
    trial = try_program(("sh", "-c", "echo so far; exec sleep 60"), timeout_s=1.0)
    assert (trial.end, trial.stdout) == ("timed out", "so far\n")


def test_library_output_around_a_programs_json_is_ignored() -> None:
    output = "print('[Error] shared memory'); print('{\"a\": 1}'); print('{\"b\": 2}')"
    assert json_output(try_program(program(output), timeout_s=20.0)) == {"a": 1, "b": 2}


def test_a_compiler_that_the_user_chose_and_that_fails_is_to_be_unset(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("CXX", raising=False)
    for command, complaint in (
        ("no-such-compiler", "no C compiler found"),
        ("false", "false failed"),
    ):
        monkeypatch.setenv("CC", command)
        facts = probe_compiler()
        assert facts.fault.startswith(complaint)
        assert facts.fix == "unset CC"


def test_a_missing_numpy_is_not_fixed_with_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numpy", None)
    assert "numpy" in probe_compiler().fix


def test_without_ros_no_build_is_recommended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "src" / "my_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "msg" / "Turn.msg").write_text("float64 angle\n")
    manifest = "<package><name>my_msgs</name><version>1.0.0</version></package>"
    (package / "package.xml").write_text(manifest)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    facts = probe_workspace(package, {})
    assert facts.fault
    assert facts.fix.startswith("pip install")


def test_an_invalid_domain_is_reported_by_discovery_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    with pytest.raises(CommandFailedError) as fault:
        probe_discovery()
    assert fault.value.help == "export ROS_DOMAIN_ID=0"


def test_a_missing_program_has_failed() -> None:
    assert try_program(("/no/such/program",), timeout_s=1.0).end == "failed"


def test_a_module_in_the_working_folder_shadows_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('not me')\n")
    monkeypatch.chdir(tmp_path)
    command = child_command("interfaces", "no_such_msgs")
    assert "no_such_msgs" in try_program(command, timeout_s=20.0).stdout


def test_a_missing_message_package_has_a_fault() -> None:
    assert load_error("no_such_msgs") == "No module named 'no_such_msgs'"


def test_missing_shared_memory_has_no_size(tmp_path: Path) -> None:
    assert probe_shared_memory(tmp_path / "nowhere").total_bytes is None


def test_shared_memory_is_measured_and_its_dds_files_counted(tmp_path: Path) -> None:
    (tmp_path / "fastrtps_port7400").touch()
    facts = probe_shared_memory(tmp_path)
    assert (facts.dds_files, facts.fault) == (1, "")
    assert facts.total_bytes


def test_the_kernels_files_report_processors(tmp_path: Path) -> None:
    for cpu, governor in enumerate(("powersave", "performance", "powersave")):
        folder = tmp_path / f"cpu/cpu{cpu}/cpufreq"
        folder.mkdir(parents=True)
        (folder / "scaling_governor").write_text(f"{governor}\n")
    quota = tmp_path / "cpu.max"
    quota.write_text("150000 100000\n")
    facts = probe_cpu(tmp_path, quota)
    assert facts.governors == {"powersave": 2, "performance": 1}
    assert (facts.quota, facts.clock) == (1.5, "")
    quota.write_text("max 100000\n")
    assert probe_cpu(tmp_path, quota).quota is None


def test_missing_folders_are_judged_by_their_existing_parents(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    environment = {"OBK_HOME": str(tmp_path / "new"), "XDG_CACHE_HOME": str(tmp_path / "file/in")}
    runs, cache, _ = probe_folders(environment)
    assert (runs.folder, runs.fault) == (str(tmp_path / "new/runs"), "")
    assert cache.fault == f"{tmp_path / 'file'} is a file"
    assert not (tmp_path / "new").exists()


def test_links_to_one_obk_count_once(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "link", "other")]
    for folder in folders:
        folder.mkdir()
    for folder in (folders[0], folders[2]):
        (folder / "obk").write_text("#!/bin/sh\n")
        (folder / "obk").chmod(0o755)
    (folders[1] / "obk").symlink_to(folders[0] / "obk")
    facts = probe_paths({"PATH": os.pathsep.join(map(str, folders))})
    assert facts.obk_programs == (str(folders[0] / "obk"), str(folders[2] / "obk"))


def test_python_paths_that_hold_an_rclpy_are_found(tmp_path: Path) -> None:
    (tmp_path / "ros/rclpy").mkdir(parents=True)
    facts = probe_paths({"PATH": "", "PYTHONPATH": f"{tmp_path}:{tmp_path / 'ros'}"})
    assert facts.python_path_with_rclpy == (str(tmp_path / "ros"),)


def test_library_paths_that_hold_another_ros_are_found(tmp_path: Path) -> None:
    (tmp_path / "librcl.so").touch()
    own = Path(sys.prefix, "lib")
    facts = probe_paths({"PATH": "", "LD_LIBRARY_PATH": f"{own}:{tmp_path}"})
    assert facts.libraries_with_rcl == (str(tmp_path),)


@pytest.mark.parametrize("display", [":998", "nonsense", "127.0.0.1:59000"])
def test_a_display_without_a_server_does_not_respond(
    display: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", display)
    facts = probe_display()
    assert facts.names == (f"DISPLAY={display}",)
    assert facts.fault


def test_an_invalid_domain_is_a_fault_of_the_middlewares(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    facts = probe_rmw()
    assert facts.domain is None
    assert facts.domain_fault == "ROS_DOMAIN_ID=many is not a number from 0 to 232"


def test_a_folder_without_packages_is_no_workspace(tmp_path: Path) -> None:
    assert probe_workspace(tmp_path, {}).folder is None


def test_a_workspaces_packages_are_reported_with_their_faults(tmp_path: Path) -> None:
    for folder, name in (("one", "<name>a</name>"), ("two", "<name>a</name>"), ("three", "")):
        package = tmp_path / "src" / folder
        package.mkdir(parents=True)
        (package / "package.xml").write_text(f"<package>{name}</package>")
    facts = probe_workspace(tmp_path / "src/one", {})
    assert (facts.folder, facts.packages, facts.doubled) == (str(tmp_path), ("a",), ("a",))
    assert facts.broken == (str(tmp_path / "src/three/package.xml"),)


def test_sockets_are_tried_in_the_run_folder_and_removed(tmp_path: Path) -> None:
    facts = probe_transport({"OBK_HOME": str(tmp_path)})
    assert (facts.is_on, facts.fault) == (True, "")
    assert not list(tmp_path.iterdir())
    assert not probe_transport({"OBK_HOME": str(tmp_path), "OBK_LOCAL_TRANSPORT": "off"}).is_on
