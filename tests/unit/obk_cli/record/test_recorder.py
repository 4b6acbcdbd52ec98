"""A recorder's reports about topics that it cannot record, without messages."""

from types import SimpleNamespace
from typing import Any

from obk_cli.record.recorder import RosRecorder
from obk_cli.record.recorder_job import RecordRequest


def test_topics_that_cannot_be_recorded_are_reported_once() -> None:
    reported: list[str] = []
    graph = {"/odd": ["a/msg/A", "b/msg/B"]}
    node: Any = SimpleNamespace(get_topic_names_and_types=graph.items)
    request = RecordRequest(topics={"/typo": None}, patterns=("/o*", "/amr/*"))
    recorder = RosRecorder(node, SimpleNamespace(), request, reported.append)  # type: ignore[arg-type]
    recorder.poll_graph()
    graph.clear()
    recorder.finish()
    clashing, missing, unmatched = reported
    assert all(word in clashing for word in ("warning: /odd", "a/msg/A", "b/msg/B"))
    assert "/typo" in missing
    assert "`/amr/*`" in unmatched
