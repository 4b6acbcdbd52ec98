"""`obk launch --render`: requests that are rejected before anything starts."""

from pathlib import Path

import pytest

from obk_cli.cli.main import main
from obk_cli.errors import CommandFailedError
from obk_cli.launch import options
from obk_cli.launch.options import RenderArguments, with_render
from obk_cli.launch.process_groups import share_of
from obk_cli.plan.plan import Plan, PlannedNode

from ..plans import node  # noqa: TID252 - shared by folders of tests

DUMMY = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.yaml"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of the user."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys, *arguments, code=2):
    """The error message of a rejected launch of the dummy."""
    with pytest.raises(SystemExit) as ended:
        main(("launch", str(DUMMY), *arguments))
    assert ended.value.code == code
    return capsys.readouterr().err


def test_an_unknown_file_type(capsys) -> None:
    assert refused(capsys, "--render", "out.avi") == (
        "error: `--render`: `out.avi`: expected a file name that ends in .mp4, .gif or .png\n"
    )


def test_an_invalid_size(capsys) -> None:
    assert refused(capsys, "--render", "out.mp4", "--render-size", "big") == (
        "error: `--render`: the size `big`; expected width and height in pixels, `640x480`\n"
    )


def test_an_invalid_rate(capsys) -> None:
    assert refused(capsys, "--render", "out.mp4", "--render-fps", "0") == (
        "error: `--render-fps 0`: expected a number of at least 1\n"
    )


@pytest.mark.mujoco
def test_a_camera_that_the_model_has_not(capsys) -> None:
    output = refused(capsys, "--render", "out.mp4", "--render-camera", "overvew")
    assert output.startswith("error: `--render-camera overvew`: ")
    assert output.endswith("dummy.xml has no such camera\n  help: did you mean `overview`?\n")


def test_options_without_a_video(capsys) -> None:
    assert refused(capsys, "--render-camera", "overview") == (
        "error: `--render-camera` needs `--render FILE`\n"
    )


def test_a_stack_whose_robot_is_not_simulated(capsys) -> None:
    real = ("--set", "onboard.robot[0].is_simulated=False", "--ignore", "OBK")
    message = refused(capsys, "--render", "out.mp4", *real)
    assert "error: `--render out.mp4`: no simulated robot in `dummy`\n" in message


def test_a_missing_folder(capsys, folder) -> None:
    assert refused(capsys, "--render", "none/out.mp4", code=1) == (
        f"error: {folder}/none/out.mp4: the folder {folder}/none does not exist\n"
    )


def test_an_existing_file(capsys, folder) -> None:
    (folder / "out.mp4").write_text("mine")
    assert refused(capsys, "--render", "out.mp4", code=1) == (
        f"error: {folder}/out.mp4 already exists\n  help: choose another file\n"
    )
    assert (folder / "out.mp4").read_text() == "mine"


def robot(name: str) -> PlannedNode:
    return node(name, "robot", model="arm.xml")


def filmed(*robots: PlannedNode, **words):
    plan = Plan(name="s", nodes=robots)
    given = {"camera": None, "size": None, "rate_hz": None, **words}
    return with_render(plan, share_of(plan, None), RenderArguments(**given))


def test_a_stack_with_several_simulated_robots() -> None:
    with pytest.raises(Exception, match="several simulated robots run here: `/a`, `/b`"):
        filmed(robot("a"), robot("b"), path=Path("out.mp4"))


def test_a_library_that_is_missing(monkeypatch) -> None:
    def missing(module, extra):
        raise CommandFailedError(f"{module}, {extra}")

    monkeypatch.setattr(options, "require_extra", missing)
    with pytest.raises(CommandFailedError, match="av, render"):
        filmed(robot("a"), path=Path("out.mp4"))


def test_the_robot_gets_the_film_with_its_whole_path(monkeypatch, folder) -> None:
    monkeypatch.setattr(options, "require_extra", lambda *_: None)
    (one,) = filmed(robot("a"), path=Path("out.gif"), size="320x240", rate_hz=10).nodes
    assert one.parameters == {
        "render": str(folder / "out.gif"),
        "render_camera": "",
        "render_size": "320x240",
        "render_fps": 10,
    }


def test_without_a_film_the_plan_is_as_it_was() -> None:
    plan = Plan(name="s", nodes=(robot("a"),))
    words = RenderArguments(path=None, camera=None, size=None, rate_hz=None)
    assert with_render(plan, share_of(plan, None), words) is plan
