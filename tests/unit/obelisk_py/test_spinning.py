"""The gate, as used by the nodes and by the launcher."""

import os
import threading
from pathlib import Path

import pytest

from obelisk_py.core.spinning import wait_at_gate
from obelisk_spec.runtime_protocol import GATE_VARIABLE
from obk_cli.launch.commands import closed_gate, gate_path

from ...waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests


def test_without_a_gate_nothing_waits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(GATE_VARIABLE, raising=False)
    wait_at_gate()
    monkeypatch.setenv(GATE_VARIABLE, str(gate_path(tmp_path)))
    wait_at_gate()


def test_a_closed_gate_blocks_until_it_opens(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(GATE_VARIABLE, str(gate_path(tmp_path)))
    is_through = threading.Event()

    def wait() -> None:
        wait_at_gate()
        is_through.set()

    waiting = threading.Thread(target=wait, daemon=True)
    with closed_gate(tmp_path):
        waiting.start()
        assert not is_through.wait(0.05)
    assert is_through.wait(DEADLINE_S)
    waiting.join()
    wait_at_gate()


def test_only_the_user_gets_at_the_gate(tmp_path: Path) -> None:
    with closed_gate(tmp_path):
        assert gate_path(tmp_path).stat().st_mode & 0o777 == 0o600
    assert os.access(gate_path(tmp_path), os.R_OK)
