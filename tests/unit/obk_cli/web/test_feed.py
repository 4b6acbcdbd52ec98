"""The data about a running stack that pages receive."""

import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from obk_cli.errors import MisuseError
from obk_cli.monitor.model import StackView
from obk_cli.runs.folder import plan_of_run
from obk_cli.web.feed import Feed, Snapshot, live_picture

from ..monitor.stacks import ELSEWHERE, HEALTHY  # noqa: TID252 - shared by folders of tests


class Script:
    """Yields these views, then ends; raises items that are exceptions."""

    def __init__(self, *views: StackView | Exception | None) -> None:
        self._views = views

    def views(self) -> Iterator[StackView | None]:
        for view in self._views:
            if isinstance(view, Exception):
                raise view
            yield view

    def stop(self) -> None:
        pass


def last_moment(folder: Path, *views: StackView | None) -> Snapshot:
    is_over = threading.Event()
    feed = Feed(Script(*views), folder, is_over.set)
    feed.start()
    assert is_over.wait(20)
    feed.stop()
    return feed.snapshot


def test_the_latest_view_is_shown(tmp_path: Path) -> None:
    snapshot = last_moment(tmp_path, ELSEWHERE, HEALTHY)
    assert snapshot == Snapshot(number=2, view=HEALTHY, is_waiting=False)


def test_the_last_stack_is_shown_while_the_next_one_is_awaited(tmp_path: Path) -> None:
    ended = replace(HEALTHY, has_ended=True)
    assert last_moment(tmp_path, HEALTHY, ended).is_waiting
    assert last_moment(tmp_path, HEALTHY, ended, None).view == ended
    assert not last_moment(tmp_path, ended, None, HEALTHY).is_waiting


def test_without_a_stack_nothing_is_shown(tmp_path: Path) -> None:
    assert last_moment(tmp_path, None) == Snapshot(number=1)


def test_the_end_of_monitoring_is_reported_at_the_end_of_the_server(tmp_path: Path) -> None:
    is_over = threading.Event()
    feed = Feed(Script(MisuseError("several stacks run")), tmp_path, is_over.set)
    feed.start()
    assert is_over.wait(20)
    with pytest.raises(MisuseError, match="several stacks run"):
        feed.stop()


def test_the_picture_is_that_of_the_run(tmp_path: Path, repository: Path) -> None:
    plan = json.loads((repository / "tests" / "golden" / "dummy.plan.json").read_text())
    folder = tmp_path / HEALTHY.run
    folder.mkdir()
    (folder / "run.json").write_text(json.dumps({"plan": plan}))
    picture = last_moment(tmp_path, HEALTHY).picture
    assert picture == live_picture(plan_of_run(folder))
    for name in ('data-node="/obelisk_control_0"', 'data-topic="/obelisk/dummy/est"'):
        assert name in picture
    assert last_moment(tmp_path, HEALTHY, ELSEWHERE).picture == ""
