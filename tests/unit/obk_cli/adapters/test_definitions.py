"""Definitions of types as they lie in the folders of their packages."""

from pathlib import Path

import pytest

from obk_cli.adapters.definitions import installed_definition


def test_a_definition_is_read_whatever_its_comments_are_written_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "share" / "arm_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Joint.msg").write_bytes("# Größe\nfloat64 angle\n".encode("latin-1"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    text = installed_definition("arm_msgs", "Joint")
    assert text is not None
    assert text.endswith("float64 angle\n")
    assert installed_definition("arm_msgs", "Wrist") is None
