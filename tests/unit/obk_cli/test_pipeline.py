from pathlib import Path

import pytest

from obk_cli.pipeline import Options, Outcome, compile_config, compile_source
from obk_cli.source import SourceFile

CASES = Path(__file__).parents[2] / "cases"
SOUND = (CASES / "accept/OBK004/topic_twice.yaml").read_text()


def options(folder: Path, **more: tuple[str, ...]) -> Options:
    return Options(
        environment={}, working_folder=folder, ignore=more.pop("ignore", ("OBK4",)), **more
    )


def compile_text(text: str, **more: tuple[str, ...]) -> Outcome:
    return compile_source(SourceFile.of("<text>", text), options(Path.cwd(), **more))


def codes(outcome: Outcome) -> list[str]:
    return [diagnostic.code for diagnostic in outcome.diagnostics]


def test_a_file_that_cannot_be_read_is_a_finding(tmp_path: Path) -> None:
    outcome = compile_config("none.yaml", options(tmp_path))
    assert [str(d) for d in outcome.diagnostics] == [
        "none.yaml:1:1: error[OBK001]: `none.yaml` cannot be read: there is no such file"
    ]
    assert "it is a folder" in str(compile_config(str(tmp_path), options(tmp_path)).diagnostics[0])


def test_a_sound_config_has_a_plan() -> None:
    outcome = compile_text(SOUND)
    assert outcome.diagnostics == ()
    assert outcome.plan is not None
    assert [p.section for p in outcome.plan.processes] == ["control", "estimation", "robot"]


def test_compiling_twice_gives_equal_plans() -> None:
    assert compile_text(SOUND).plan == compile_text(SOUND).plan


@pytest.mark.parametrize(
    "text",
    [
        SOUND.replace("topic: /arm/joints", "topic: /arm/sensor  # obk: ignore[OBK203]", 1),
        SOUND.replace("topic: /arm/joints", "topic: /arm/sensor", 1) + "obk: {ignore: [OBK203]}\n",
    ],
)
def test_a_finding_may_be_silenced_in_the_config(text: str) -> None:
    outcome = compile_text(text)
    assert codes(outcome) == []
    assert outcome.plan is not None


def test_a_family_may_be_silenced_for_a_run() -> None:
    assert codes(compile_text(SOUND, ignore=("OBK4", "OBK2"))) == []
    assert codes(compile_text(SOUND.replace("/est\n", "/e\n", 1), ignore=("OBK4", "OBK2"))) == []


def test_what_no_plan_could_be_made_of_is_always_heard() -> None:
    outcome = compile_text(SOUND.replace("    executable: controller\n", ""), ignore=("OBK",))
    assert codes(outcome) == ["OBK102"]
    assert outcome.plan is None


def test_overrides_come_last() -> None:
    outcome = compile_text(SOUND, overrides=("control[0].name=mpc", "config=other"))
    assert outcome.plan is not None
    assert outcome.plan.name == "other"
    assert outcome.plan.processes[0].node == "obelisk_control_mpc"


def test_independent_faults_are_all_found_in_one_run() -> None:
    text = SOUND.replace("timer_period_sec: 0.01", "timer_period_sec: -1", 1)
    text = text.replace("executable: estimator", "executable: estimator\n    nmae: x")
    text = text.replace("/arm/joints", "/arm/sensor", 1).replace("config: arm", "config: 3")
    assert codes(compile_text(text)) == ["OBK103", "OBK104", "OBK101", "OBK203"]
