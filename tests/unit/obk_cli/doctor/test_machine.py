"""Judges of memory, compilers, graphics, limits, processors and folders, in made-up worlds."""

from dataclasses import replace

import pytest

from obk_cli.doctor.compiler import CompilerFacts, judge_compiler
from obk_cli.doctor.display import DisplayFacts, judge_display
from obk_cli.doctor.folders import FolderFacts, judge_folders
from obk_cli.doctor.memory import SharedMemoryFacts, judge_shared_memory
from obk_cli.doctor.mujoco import DrawingTrial, MujocoFacts, judge_mujoco
from obk_cli.doctor.sizes import GIB, MIB, told_bytes
from obk_cli.doctor.timing import CpuFacts, RealtimeFacts, judge_cpu, judge_realtime
from obk_cli.doctor.trial import Trial

from .findings import severities, the_one

MEMORY = SharedMemoryFacts(total_bytes=8 * GIB, free_bytes=7 * GIB, fault="", dds_files=3)
DONE = Trial(end="done", said="", complaint="", seconds=1.0)
CRASHED = Trial(end="crashed", said="", complaint="", signal="SIGSEGV", seconds=1.0)
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


def test_a_sound_machine_gives_no_complaint() -> None:
    found = [
        *judge_shared_memory(MEMORY),
        *judge_compiler(CompilerFacts(commands=("gcc", "g++"), fault="")),
        *judge_mujoco(MUJOCO),
        *judge_display(DisplayFacts(names=("DISPLAY=:0",), fault="", is_ssh=False)),
        *judge_realtime(REALTIME),
        *judge_cpu(CPU),
        *judge_folders((FOLDER,)),
    ]
    assert set(severities(found)) == {"ok"}


def test_a_machine_without_shared_memory_is_told() -> None:
    found = the_one(judge_shared_memory(replace(MEMORY, total_bytes=None)), "warning")
    assert found.message.startswith("there is no /dev/shm")


def test_shared_memory_that_cannot_be_written_is_told() -> None:
    found = the_one(judge_shared_memory(replace(MEMORY, fault="Permission denied")), "warning")
    assert found.cure.endswith("sudo chmod 1777 /dev/shm")


@pytest.mark.parametrize(
    ("total_bytes", "much", "cure"),
    [
        (
            64 * MIB,
            "64 MiB",
            "sudo mount -o remount,size=512M /dev/shm    # a container: docker run --shm-size=512m",
        ),
        (8 * GIB, "8.0 GiB", "obk reap"),
    ],
)
def test_little_room_in_shared_memory_is_cured_by_size_or_by_clearing(
    total_bytes: int, much: str, cure: str
) -> None:
    world = replace(MEMORY, total_bytes=total_bytes, free_bytes=20 * MIB)
    found = the_one(judge_shared_memory(world), "warning")
    assert found.message == f"/dev/shm has 20 MiB of {much} free; DDS wants 64 MiB or more"
    assert found.cure == cure


def test_many_files_of_dds_are_noted() -> None:
    assert the_one(judge_shared_memory(replace(MEMORY, dds_files=900)), "note").cure == "obk reap"


def test_a_missing_compiler_is_told_with_what_to_install() -> None:
    found = the_one(judge_compiler(CompilerFacts(commands=(), fault="no C compiler")), "warning")
    assert found.message == "message packages cannot be built: no C compiler"


def test_a_missing_mujoco_is_told() -> None:
    found = the_one(judge_mujoco(replace(MUJOCO, version=None)), "warning")
    assert found.cure == "pip install 'obelisk-cli[sim]'"


def test_a_mujoco_that_does_not_step_is_an_error() -> None:
    broken = replace(CRASHED_DRAWING, has_stepped=False)
    found = the_one(judge_mujoco(replace(MUJOCO, back_ends={"egl": broken})), "error")
    assert found.message.endswith("does not step a tiny model: was ended by SIGSEGV")


def test_a_back_end_that_crashes_is_noted_and_the_others_count() -> None:
    back_ends = {**MUJOCO.back_ends, "osmesa": CRASHED_DRAWING}
    found = [*judge_mujoco(replace(MUJOCO, back_ends=back_ends))]
    told = the_one(found, "note")
    assert told.message == "MUJOCO_GL=osmesa was ended by SIGSEGV"
    assert told.cure == "apt install libosmesa6"


def test_the_chosen_back_end_that_does_not_draw_is_told_with_one_that_does() -> None:
    back_ends = {"egl": DRAWN, "osmesa": replace(DRAWN, has_drawn=False)}
    found = [*judge_mujoco(replace(MUJOCO, chosen="osmesa", back_ends=back_ends))]
    told = the_one(found, "warning")
    assert told.message == (
        "MUJOCO_GL=osmesa drew a picture of one colour; it is the one that is chosen"
    )
    assert told.cure == "export MUJOCO_GL=egl"


def test_without_a_display_nothing_is_to_be_done_for_glfw() -> None:
    back_ends = {"egl": DRAWN, "glfw": CRASHED_DRAWING}
    world = replace(MUJOCO, has_display=False, back_ends=back_ends)
    found = the_one(judge_mujoco(world), "note")
    assert (found.message.endswith("; it needs a display"), found.cure) == (True, "")


def test_no_back_end_at_all_is_told_once() -> None:
    back_ends = {"egl": CRASHED_DRAWING, "osmesa": CRASHED_DRAWING}
    found = [*judge_mujoco(replace(MUJOCO, back_ends=back_ends))]
    assert the_one(found, "warning").message.endswith("cameras give no images")


@pytest.mark.parametrize(
    ("is_ssh", "cure"), [(True, "ssh -X ..."), (False, "export MUJOCO_GL=egl")]
)
def test_no_display_is_noted(is_ssh: bool, cure: str) -> None:
    found = the_one(judge_display(DisplayFacts(names=(), fault="", is_ssh=is_ssh)), "note")
    assert found.cure == cure


def test_a_display_that_does_not_answer_is_noted() -> None:
    world = DisplayFacts(names=("DISPLAY=:7",), fault="Connection refused", is_ssh=False)
    assert the_one(judge_display(world), "note").message == (
        "DISPLAY=:7 does not answer: Connection refused"
    )


def test_no_realtime_priority_is_noted_with_the_line_for_this_user() -> None:
    world = replace(REALTIME, got_priority=False, highest_priority=0)
    assert the_one(judge_realtime(world), "note").cure == (
        "echo 'ada - rtprio 98' | sudo tee -a /etc/security/limits.d/obelisk.conf"
        "    # then log in again"
    )


def test_little_locked_memory_is_noted() -> None:
    found = the_one(judge_realtime(replace(REALTIME, locked_bytes=8 * MIB)), "note")
    assert found.message.startswith("only 8 MiB of memory can be locked")


def test_one_processor_is_told_also_where_a_container_allows_no_more() -> None:
    for world in (replace(CPU, usable=1), replace(CPU, quota=1.0)):
        assert the_one(judge_cpu(world), "warning").message.startswith("1 processor:")


def test_more_work_than_processors_is_noted() -> None:
    assert the_one(judge_cpu(replace(CPU, load=5.2)), "note").message == (
        "4 processors, and 5.2 processes want them: loops will be late"
    )


def test_a_governor_that_saves_power_is_noted() -> None:
    world = replace(CPU, governors={"powersave": 3, "performance": 1})
    assert the_one(judge_cpu(world), "note").message == (
        "processors slow down between ticks (frequency governor powersave on 3)"
    )


@pytest.mark.parametrize(
    ("world", "slow"),
    [
        (replace(CPU, clock="hpet"), "hpet takes 50 ns"),
        (replace(CPU, clock_read_ns=900.0), "tsc takes 900 ns"),
    ],
)
def test_a_slow_clock_is_noted(world: CpuFacts, slow: str) -> None:
    assert the_one(judge_cpu(world), "note").message == (
        f"the clock {slow} to read; loops read it often"
    )


def test_a_folder_that_cannot_be_written_is_told_with_what_moves_it() -> None:
    found = the_one(judge_folders((replace(FOLDER, fault="Read-only file system"),)), "warning")
    assert found.message == "runs: /state/runs: Read-only file system"
    assert found.cure.startswith("export OBK_HOME=")


def test_a_user_without_a_place_for_a_folder_is_told() -> None:
    found = the_one(judge_folders((replace(FOLDER, folder=None),)), "warning")
    assert found.message == "there is no place for runs"


@pytest.mark.parametrize(
    ("free_bytes", "much"), [(500 * MIB, "filling up"), (20 * MIB, "almost full")]
)
def test_a_disk_with_little_room_is_told(free_bytes: int, much: str) -> None:
    found = the_one(judge_folders((replace(FOLDER, free_bytes=free_bytes),)), "warning")
    assert found.message == (
        f"runs: the disk of /state/runs is {much}, {told_bytes(free_bytes)} free"
    )


def test_sizes_are_told_in_the_nearer_unit() -> None:
    assert (told_bytes(64 * MIB), told_bytes(3 * GIB // 2)) == ("64 MiB", "1.5 GiB")
