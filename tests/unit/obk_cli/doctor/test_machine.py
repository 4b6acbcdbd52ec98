"""Checks of memory, compilers, graphics, limits, processors and folders, in fake worlds."""

from dataclasses import replace

import pytest

from obk_cli.doctor.child import Trial
from obk_cli.doctor.finding import GIB, MIB, bytes_text
from obk_cli.doctor.interfaces import CompilerFacts, judge_compiler
from obk_cli.doctor.machine import (
    CpuFacts,
    FolderFacts,
    RealtimeFacts,
    SharedMemoryFacts,
    TransportFacts,
    judge_cpu,
    judge_folders,
    judge_realtime,
    judge_shared_memory,
    judge_transport,
)
from obk_cli.doctor.mujoco import (
    DisplayFacts,
    DrawingTrial,
    MujocoFacts,
    judge_display,
    judge_mujoco,
)
from obk_cli.install_source import install_command

from .findings import severities, the_one

MEMORY = SharedMemoryFacts(total_bytes=8 * GIB, free_bytes=7 * GIB, fault="", dds_files=3)
TRANSPORT = TransportFacts(is_on=True, folder="/state/runs", fault="")
DONE = Trial(end="done", stdout="", last_error="", seconds=1.0)
CRASHED = Trial(end="crashed", stdout="", last_error="", signal="SIGSEGV", seconds=1.0)
DRAWN = DrawingTrial(trial=DONE, has_stepped=True, has_drawn=True, renderer="llvmpipe")
CRASHED_DRAWING = DrawingTrial(trial=CRASHED, has_stepped=True, has_drawn=False)
MUJOCO = MujocoFacts(
    version="4.0.0",
    chosen="",
    has_display=True,
    back_ends={"egl": DRAWN, "osmesa": DRAWN, "glfw": DRAWN},
)
REALTIME = RealtimeFacts(highest_priority=98, got_priority=True, locked_bytes=-1, user="ada")
CPU = CpuFacts(usable=4, quota=None, load=0.5, governors={}, clock="tsc", clock_read_ns=50.0)
FOLDER = FolderFacts(
    purpose="runs", folder="/state/runs", fault="", free_bytes=9 * GIB, mover="OBK_HOME"
)


def test_a_healthy_machine_gives_no_findings() -> None:
    found = [
        *judge_shared_memory(MEMORY),
        *judge_transport(TRANSPORT),
        *judge_compiler(CompilerFacts(commands=("gcc", "g++"), fault="")),
        *judge_mujoco(MUJOCO),
        *judge_display(DisplayFacts(names=("DISPLAY=:0",), fault="", is_ssh=False)),
        *judge_realtime(REALTIME),
        *judge_cpu(CPU),
        *judge_folders((FOLDER,)),
    ]
    assert set(severities(found)) == {"ok"}


def test_a_local_transport_that_is_off_or_has_no_sockets_is_reported() -> None:
    the_one(judge_transport(replace(TRANSPORT, is_on=False)), "ok")
    found = the_one(judge_transport(replace(TRANSPORT, fault="Operation not permitted")), "warning")
    assert "OBK_HOME" in found.fix


def test_a_machine_without_shared_memory_is_reported() -> None:
    the_one(judge_shared_memory(replace(MEMORY, total_bytes=None)), "warning")


def test_shared_memory_that_cannot_be_written_is_reported() -> None:
    found = the_one(judge_shared_memory(replace(MEMORY, fault="Permission denied")), "warning")
    assert found.fix.endswith("sudo chmod 1777 /dev/shm")


@pytest.mark.parametrize(
    ("total_bytes", "fix"),
    [
        (
            64 * MIB,
            "sudo mount -o remount,size=512M /dev/shm    # a container: docker run --shm-size=512m",
        ),
        (8 * GIB, "obk reap"),
    ],
)
def test_little_shared_memory_is_fixed_by_size_or_by_clearing(total_bytes: int, fix: str) -> None:
    world = replace(MEMORY, total_bytes=total_bytes, free_bytes=20 * MIB)
    found = the_one(judge_shared_memory(world), "warning")
    assert found.fix == fix


def test_many_files_of_dds_are_noted() -> None:
    assert the_one(judge_shared_memory(replace(MEMORY, dds_files=900)), "note").fix == "obk reap"


def test_a_missing_compiler_is_reported_with_the_package_to_install() -> None:
    the_one(judge_compiler(CompilerFacts(commands=(), fault="no C compiler")), "warning")


def test_a_missing_mujoco_is_reported() -> None:
    found = the_one(judge_mujoco(replace(MUJOCO, version=None)), "warning")
    assert found.fix == install_command("sim")


def test_a_mujoco_that_does_not_step_is_an_error() -> None:
    broken = replace(CRASHED_DRAWING, has_stepped=False)
    found = the_one(judge_mujoco(replace(MUJOCO, back_ends={"egl": broken})), "error")
    assert "SIGSEGV" in found.message


def test_a_back_end_that_crashes_is_noted_and_the_others_count() -> None:
    back_ends = {**MUJOCO.back_ends, "osmesa": CRASHED_DRAWING}
    found = [*judge_mujoco(replace(MUJOCO, back_ends=back_ends))]
    reported = the_one(found, "note")
    assert reported.fix == "apt install libosmesa6"


def test_the_chosen_back_end_that_does_not_draw_is_reported_with_one_that_does() -> None:
    back_ends = {"egl": DRAWN, "osmesa": replace(DRAWN, has_drawn=False)}
    found = [*judge_mujoco(replace(MUJOCO, chosen="osmesa", back_ends=back_ends))]
    reported = the_one(found, "warning")
    assert reported.fix == "export MUJOCO_GL=egl"


def test_without_a_display_nothing_is_to_be_done_for_glfw() -> None:
    back_ends = {"egl": DRAWN, "glfw": CRASHED_DRAWING}
    world = replace(MUJOCO, has_display=False, back_ends=back_ends)
    found = the_one(judge_mujoco(world), "note")
    assert (found.message.endswith("; it needs a display"), found.fix) == (True, "")


def test_a_missing_back_end_is_reported_once() -> None:
    back_ends = {"egl": CRASHED_DRAWING, "osmesa": CRASHED_DRAWING}
    found = [*judge_mujoco(replace(MUJOCO, back_ends=back_ends))]
    the_one(found, "warning")


@pytest.mark.parametrize(("is_ssh", "fix"), [(True, "ssh -X ..."), (False, "export MUJOCO_GL=egl")])
def test_no_display_is_noted(is_ssh: bool, fix: str) -> None:
    found = the_one(judge_display(DisplayFacts(names=(), fault="", is_ssh=is_ssh)), "note")
    assert found.fix == fix


def test_a_display_that_does_not_answer_is_noted() -> None:
    world = DisplayFacts(names=("DISPLAY=:7",), fault="Connection refused", is_ssh=False)
    assert "Connection refused" in the_one(judge_display(world), "note").message


def test_no_realtime_priority_is_noted_with_the_line_for_this_user() -> None:
    world = replace(REALTIME, got_priority=False, highest_priority=0)
    assert the_one(judge_realtime(world), "note").fix == (
        "echo 'ada - rtprio 98' | sudo tee -a /etc/security/limits.d/obelisk.conf"
        "    # then log in again"
    )


def test_little_locked_memory_is_noted() -> None:
    the_one(judge_realtime(replace(REALTIME, locked_bytes=8 * MIB)), "note")


def test_one_processor_is_reported_even_if_a_container_sets_the_limit() -> None:
    for world in (replace(CPU, usable=1), replace(CPU, quota=1.0)):
        assert the_one(judge_cpu(world), "warning").message.startswith("1 processor:")


def test_more_work_than_processors_is_noted() -> None:
    the_one(judge_cpu(replace(CPU, load=5.2)), "note")


def test_a_governor_that_saves_power_is_noted() -> None:
    world = replace(CPU, governors={"powersave": 3, "performance": 1})
    assert the_one(judge_cpu(world), "note").facts["governors"]


@pytest.mark.parametrize(
    ("world", "measured"),
    [
        (replace(CPU, clock="hpet"), ("hpet", 50)),
        (replace(CPU, clock_read_ns=900.0), ("tsc", 900)),
    ],
)
def test_a_slow_clock_is_noted(world: CpuFacts, measured: tuple[str, int]) -> None:
    facts = the_one(judge_cpu(world), "note").facts
    assert (facts["clock"], facts["read_ns"]) == measured


def test_a_read_only_folder_is_reported_with_the_setting_that_moves_it() -> None:
    found = the_one(judge_folders((replace(FOLDER, fault="Read-only file system"),)), "warning")
    assert found.fix.startswith("export OBK_HOME=")


def test_a_user_without_a_folder_is_reported() -> None:
    the_one(judge_folders((replace(FOLDER, folder=None),)), "warning")


@pytest.mark.parametrize(
    ("free_bytes", "much"), [(500 * MIB, "filling up"), (20 * MIB, "almost full")]
)
def test_a_disk_with_little_room_is_reported(free_bytes: int, much: str) -> None:
    found = the_one(judge_folders((replace(FOLDER, free_bytes=free_bytes),)), "warning")
    assert much in found.message


def test_sizes_are_reported_in_the_nearer_unit() -> None:
    assert (bytes_text(64 * MIB), bytes_text(3 * GIB // 2)) == ("64 MiB", "1.5 GiB")
