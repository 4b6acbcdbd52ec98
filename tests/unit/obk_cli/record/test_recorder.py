"""What a recorder says of topics that it cannot record; no message comes."""

from types import SimpleNamespace
from typing import Any

from obk_cli.record.recorder import RosRecorder
from obk_cli.record.topic_filter import RecordRequest


def test_topics_that_are_not_recorded_are_told_once() -> None:
    told: list[str] = []
    graph = {"/odd": ["a/msg/A", "b/msg/B"]}
    node: Any = SimpleNamespace(get_topic_names_and_types=graph.items)
    request = RecordRequest(topics={"/typo": None}, patterns=("/o*", "/amr/*"))
    recorder = RosRecorder(node, SimpleNamespace(), request, told.append)  # type: ignore[arg-type]
    recorder.poll_graph()
    graph.clear()
    recorder.finish()
    assert told == [
        "warning: /odd is not recorded while it has the types a/msg/A and b/msg/B",
        "warning: /typo was not there: nothing of it is recorded",
        "warning: no topic fitted `/amr/*`: nothing of it is recorded",
    ]
