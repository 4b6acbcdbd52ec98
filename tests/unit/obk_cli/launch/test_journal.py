"""The log files of a run."""

import json
from pathlib import Path

from obk_cli.launch.event_lines import Journal, event_record
from obk_cli.launch.events import OUTPUT_EVENTS, Phase, StackStateChanged

FULL_DISK = Path("/dev/full")


def test_events_output_and_the_screen_have_separate_files(tmp_path: Path) -> None:
    faults: list[OSError] = []
    journal = Journal(tmp_path, faults.append)
    journal.event(Phase(name="active", seconds=1.0), 2.0)
    journal.line("/arm/obelisk_control_0", "\x1b[31mhello")
    journal.line("/dummy/composed", "of no node")
    journal.shown("control_0 | hello")
    journal.close()
    event = json.loads((tmp_path / "events.jsonl").read_text())
    assert event == {"time": 2.0, "event": "Phase", "name": "active", "seconds": 1.0, "detail": ""}
    assert (tmp_path / "arm.obelisk_control_0.log").read_text() == "\x1b[31mhello\n"
    assert (tmp_path / "dummy.composed.log").read_text() == "of no node\n"
    assert (tmp_path / "launch.log").read_text() == "control_0 | hello\n"
    assert not faults


def test_a_full_disk_is_reported_once_and_ends_the_writing(tmp_path: Path) -> None:
    (tmp_path / "a.log").symlink_to(FULL_DISK)
    faults: list[OSError] = []
    journal = Journal(tmp_path, faults.append)
    for _ in range(3):
        journal.line("/a", "x")
        journal.line("/b", "y")
    journal.close()
    assert [fault.strerror for fault in faults] == ["No space left on device"]
    assert not (tmp_path / "b.log").exists()


def test_without_a_folder_nothing_is_written() -> None:
    faults: list[OSError] = []
    Journal(None, faults.append).line("/a", "x")
    assert not faults


def test_the_names_of_events_are_those_of_the_json_stream() -> None:
    assert event_record(StackStateChanged(state="active"), 1.0) == {
        "time": 1.0,
        "event": "StackState",
        "state": "active",
    }
    assert set(OUTPUT_EVENTS) == {
        "ProcessStarted",
        "ProcessEnded",
        "StateSeen",
        "Failed",
        "TransitionEnded",
        "Phase",
        "StackState",
        "Hung",
        "AnswersAgain",
        "Restarting",
        "Restarted",
        "GoesOnWithout",
        "RateBroken",
        "RateKept",
        "RateMoved",
        "RatesUnreported",
        "WaitingFor",
        "Evidence",
        "SignalIgnored",
        "ActivationReported",
        "VideoReported",
        "PageReported",
        "Ended",
    }
