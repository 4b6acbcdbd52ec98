"""The lines of a run, as JSON."""

import json
from pathlib import Path

from obk_cli.launch.event_lines import Journal, JsonReport
from obk_cli.launch.events import Ended, ProcessEnded


def test_a_line_is_the_record_of_the_journal(tmp_path: Path) -> None:
    event = ProcessEnded(process="/a", code=1, text="x\ny\x1b[1m")
    journal = Journal(tmp_path, lambda error: None)
    journal.event(event, 2.5)
    journal.close()
    (line,) = JsonReport(lambda: 2.5, quiet=False).event(event)
    assert f"{line}\n" == (tmp_path / "events.jsonl").read_text()


def test_output_is_a_record_too_unless_it_is_quiet() -> None:
    (line,) = JsonReport(lambda: 1.0, quiet=False).line("/a", 'say "hi"')
    assert json.loads(line) == {"time": 1.0, "event": "Output", "node": "/a", "text": 'say "hi"'}
    assert list(JsonReport(lambda: 1.0, quiet=True).line("/a", "hi")) == []


def test_messages_of_the_launcher_are_records_too() -> None:
    report = JsonReport(lambda: 1.0, quiet=True)
    (note,) = report.note("logs in a")
    assert json.loads(note) == {"time": 1.0, "event": "Note", "text": "logs in a"}
    assert json.loads(report.left_out(3)) == {"time": 1.0, "event": "LeftOut", "lines": 3}


def test_the_last_line_reports_the_end() -> None:
    report = JsonReport(lambda: 1.0, quiet=False)
    (line,) = report.event(Ended(exit_code=1, cause="a died", origin="c.yaml:1:2"))
    assert json.loads(line) == {
        "time": 1.0,
        "event": "Ended",
        "exit_code": 1,
        "cause": "a died",
        "consequences": 0,
        "origin": "c.yaml:1:2",
    }
