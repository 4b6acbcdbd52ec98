"""`obk validate --watch` detects a change to any file of the config, once."""

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from obk_cli.cli import validate
from obk_cli.cli.main import main
from obk_cli.cli.validate import WatchedRun, check_after_changes
from obk_cli.compiler import Options
from obk_cli.workspace.model_reader import mjcf_files


def stepping(steps: Iterator[None]) -> Callable[[], None]:
    """A wait that performs the next step of a scenario, and is interrupted at its end."""

    def wait() -> None:
        try:
            next(steps)
        except StopIteration:
            raise KeyboardInterrupt from None

    return wait


def rewrite(path: Path, text: str, tick: int) -> None:
    path.write_text(text)
    os.utime(path, ns=(tick, tick))


def test_each_change_is_checked_once_when_it_has_settled(tmp_path: Path) -> None:
    path = tmp_path / "a"
    rewrite(path, "one", 1)
    seen: list[str] = []

    def check() -> dict[Path, tuple[int, int] | None]:
        seen.append(path.read_text() if path.exists() else "gone")
        state = path.stat() if path.exists() else None
        return {path: (state.st_mtime_ns, state.st_size) if state else None}

    def story() -> Iterator[None]:
        yield
        path.unlink()  # as an editor does
        yield
        rewrite(path, "two", 2)
        yield
        yield
        rewrite(path, "three", 3)
        yield
        yield
        yield

    check_after_changes(check, stepping(story()))
    assert seen == ["one", "two", "three"]


def test_every_file_that_took_part_is_marked(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    (tmp_path / "rays.yaml").write_text("site_name: a\n")
    (tmp_path / "part.yaml").write_text("control: {pkg: p, executable: e, params_path: p.txt}\n")
    config = tmp_path / "c.yaml"
    config.write_text(
        "include: [part.yaml, missing.yaml]\n"
        "robot:\n  pkg: p\n  executable: e\n  is_simulated: true\n  sim:\n"
        "    model_xml_path: arm.xml\n"
        "    sensor_settings:\n"
        "      - {topic: /s, dt: 1, msg_type: ObkScan, config_path: rays.yaml}\n"
        "      - {topic: /t, dt: 1, msg_type: ObkScan, config_path: gone.yaml}\n"
    )
    run = WatchedRun(Options(variables={}, working_folder=tmp_path))
    run.compile(str(config))
    marked = {path.name: mark is not None for path, mark in run.marks.items()}
    assert marked == {
        "c.yaml": True,
        "part.yaml": True,
        "missing.yaml": False,
        "rays.yaml": True,
        "gone.yaml": False,
        "arm.xml": True,
        "part.xml": False,
        "p.txt": False,
    }


def test_the_sources_of_nodes_and_of_their_names_are_marked(tmp_path: Path) -> None:
    package = tmp_path / "src" / "demo"
    (package / "demo").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>demo</name></package>")
    (package / "setup.py").write_text(
        "setup(entry_points={'console_scripts': ['node = demo.node:main']})"
    )
    (package / "demo" / "__init__.py").write_text("")
    (package / "demo" / "node.py").write_text("from demo.parts import main\n")
    (tmp_path / "c.yaml").write_text("control: {pkg: demo, executable: node}\n")
    run = WatchedRun(Options(variables={}, working_folder=tmp_path))
    run.compile(str(tmp_path / "c.yaml"))
    marked = {str(p.relative_to(package)): m is not None for p, m in run.marks.items()
              if p.is_relative_to(package)}  # fmt: skip
    assert marked["package.xml"]
    assert marked["setup.py"]
    assert marked["demo/node.py"]
    assert not marked["demo/parts.py"]  # it may change


@pytest.mark.mujoco
def test_the_files_of_a_model_are_marked(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(
        '<mujoco><compiler meshdir="m"/><include file="part.xml"/><asset>'
        '<mesh file="hand.stl"/></asset></mujoco>'
    )
    (tmp_path / "part.xml").write_text(
        '<mujoco><asset><model name="h" file="hand.xml"/></asset></mujoco>'
    )
    (tmp_path / "hand.xml").write_text("<mujoco/>")
    (tmp_path / "c.yaml").write_text(
        "robot: {pkg: p, executable: e, is_simulated: true, sim: {model_xml_path: arm.xml}}\n"
    )
    run = WatchedRun(Options(variables={}, working_folder=tmp_path))
    run.compile(str(tmp_path / "c.yaml"))
    marked = {str(p.relative_to(tmp_path)): m is not None for p, m in run.marks.items()}
    assert marked.items() >= {"part.xml": True, "hand.xml": True, "m/hand.stl": False}.items()


def test_a_change_while_the_check_runs_is_one(tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    rewrite(config, "control: 1\n", 1)
    run = WatchedRun(Options(variables={}, working_folder=tmp_path))
    run.compile(str(config))
    rewrite(config, "control: 2\n", 2)
    run.compile(str(config))
    assert run.marks[config] == (1, 11)


def test_models_that_include_each_other_end(tmp_path: Path) -> None:
    for name, other in (("a.xml", "b.xml"), ("b.xml", "a.xml")):
        (tmp_path / name).write_text(f'<mujoco><include file="{other}"/></mujoco>')
    assert [path.name for path in mjcf_files(tmp_path / "a.xml")] == ["a.xml", "b.xml"]


def test_the_command_prints_a_summary_with_the_time_until_it_is_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path("c.yaml")
    rewrite(path, "a: [", 1)

    def story() -> Iterator[None]:
        rewrite(path, "config: [", 2)
        yield
        yield

    monkeypatch.setattr(validate, "_wait", stepping(story()))
    with pytest.raises(SystemExit) as ended:
        main(["validate", "--watch", "c.yaml"])
    out = capsys.readouterr().out
    assert ended.value.code == 0
    assert len(re.findall(r"^\[\d\d:\d\d:\d\d\] c\.yaml: 1 error$", out, re.MULTILINE)) == 2
    assert "  1 | config: [" in out
