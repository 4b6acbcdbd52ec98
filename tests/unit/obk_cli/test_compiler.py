import gc
from pathlib import Path

import pytest

from obk_cli.cli.launch_plan import gated_executables
from obk_cli.compiler import Options, Outcome, compile_config, compile_source
from obk_cli.config import loader, yaml_parser
from obk_cli.config.suppressions import near_codes
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES, SourceFile

CASES = Path(__file__).parents[2] / "cases"
DUMMY = Path(__file__).parents[3] / "examples" / "dummy" / "dummy.yaml"
VALID_TEXT = (CASES / "accept/OBK004/topic_twice.yaml").read_text()


def options(folder: Path, **more: tuple[str, ...]) -> Options:
    return Options(
        variables={}, working_folder=folder, ignore=more.pop("ignore", ("OBK4",)), **more
    )


def compile_text(text: str, **more: tuple[str, ...]) -> Outcome:
    return compile_source(SourceFile.of("<text>", text), options(Path.cwd(), **more))


def codes(outcome: Outcome) -> list[str]:
    return [diagnostic.code for diagnostic in outcome.diagnostics]


@pytest.mark.parametrize("text", [VALID_TEXT, "control: [", ""])
@pytest.mark.parametrize("is_enabled", [True, False])
def test_garbage_is_collected_afterwards_as_it_was_before(text: str, is_enabled: bool) -> None:
    was_enabled = gc.isenabled()
    (gc.enable if is_enabled else gc.disable)()
    try:
        compile_text(text)
        assert gc.isenabled() is is_enabled
    finally:
        (gc.enable if was_enabled else gc.disable)()


def test_a_file_that_cannot_be_read_is_a_finding(tmp_path: Path) -> None:
    outcome = compile_config("none.yaml", options(tmp_path))
    assert [str(d) for d in outcome.diagnostics] == [
        "none.yaml:1:1: error[OBK001]: `none.yaml` cannot be read: file not found"
    ]
    assert "it is a directory" in str(
        compile_config(str(tmp_path), options(tmp_path)).diagnostics[0]
    )


def test_a_missing_file_gets_a_suggestion_of_an_existing_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stack.yaml").touch()
    monkeypatch.chdir(tmp_path)
    (fault,) = compile_config("stakc.yaml", options(tmp_path)).diagnostics
    assert fault.help == "did you mean `stack.yaml`?"


def test_a_valid_config_has_a_plan() -> None:
    outcome = compile_text(VALID_TEXT)
    assert outcome.diagnostics == ()
    assert outcome.plan is not None
    assert [p.section for p in outcome.plan.nodes] == ["control", "estimation", "robot"]


def test_programs_whose_source_shows_what_they_spin_are_known() -> None:
    outcome = compile_config(str(DUMMY), options(DUMMY.parent))
    assert outcome.plan is not None
    gated = gated_executables(outcome.plan, outcome.environment)
    assert gated == {(node.package, node.executable) for node in outcome.plan.nodes}


def test_compiling_twice_gives_equal_plans() -> None:
    assert compile_text(VALID_TEXT).plan == compile_text(VALID_TEXT).plan


@pytest.mark.parametrize(
    "text",
    [
        VALID_TEXT.replace("topic: /arm/joints", "topic: /arm/sensor  # obk: ignore[OBK203]", 1),
        VALID_TEXT.replace("topic: /arm/joints", "topic: /arm/sensor", 1)
        + "obk: {ignore: [OBK203]}\n",
    ],
)
def test_a_finding_may_be_silenced_in_the_config(text: str) -> None:
    outcome = compile_text(text)
    assert codes(outcome) == []
    assert outcome.plan is not None


def test_a_family_may_be_silenced_for_a_run() -> None:
    assert codes(compile_text(VALID_TEXT, ignore=("OBK4", "OBK2"))) == []
    assert (
        codes(compile_text(VALID_TEXT.replace("/est\n", "/e\n", 1), ignore=("OBK4", "OBK2"))) == []
    )


def test_findings_that_prevent_a_plan_are_never_silenced() -> None:
    outcome = compile_text(VALID_TEXT.replace("    executable: controller\n", ""), ignore=("OBK",))
    assert codes(outcome) == ["OBK102"]
    assert outcome.plan is None


def test_a_code_that_silences_nothing_is_reported_at_its_location() -> None:
    outcome = compile_text(f"{VALID_TEXT}obk: {{ignore: [OBK013]}}\n", ignore=("OBK4", "OBK9", ""))
    assert [(str(d.span), d.code, d.message) for d in outcome.diagnostics] == [
        ("<command line>:1:10", "OBK014", "unknown rule `OBK9`"),
        ("<command line>:1:10", "OBK014", "unknown rule ``"),
        ("<text>:42:16", "OBK014", "`OBK013` cannot be silenced"),
    ]
    assert outcome.plan is not None


@pytest.mark.parametrize(
    ("written", "help"),
    [
        ("OBK2O1", "did you mean `OBK201`?"),
        ("obk203", "did you mean `OBK203`?"),
        ("everything", "list the rules with `obk explain`"),
    ],
)
def test_an_unknown_code_is_reported_with_a_suggestion(written: str, help: str) -> None:
    assert near_codes(written) == help


def test_of_many_unknown_codes_only_the_first_are_compared_with_known_ones() -> None:
    text = (
        VALID_TEXT + "vars:\n" + "".join(f"  a{i}: 1 # obk: ignore[OBK9{i}]\n" for i in range(60))
    )
    helps = [fault.help for fault in compile_text(text).diagnostics if fault.code == "OBK014"]
    assert (len(helps), helps.count(None)) == (60, 10)


def test_many_unknown_keys_are_reported_without_comparing_all() -> None:
    faults = compile_text(VALID_TEXT + "".join(f"x{i}: 1\n" for i in range(500)) + "jostick: 1\n")
    assert faults.diagnostics[0].code == "OBK101"
    assert not any("did you mean" in (fault.help or "") for fault in faults.diagnostics[-20:])


def test_overrides_come_last() -> None:
    outcome = compile_text(VALID_TEXT, overrides=("control[0].name=mpc", "config=other"))
    assert outcome.plan is not None
    assert outcome.plan.name == "other"
    assert outcome.plan.nodes[0].node == "obelisk_control_mpc"


def test_independent_faults_are_all_found_in_one_run() -> None:
    text = VALID_TEXT.replace("timer_period_sec: 0.01", "timer_period_sec: -1", 1)
    text = text.replace("executable: estimator", "executable: estimator\n    nmae: x")
    text = text.replace("/arm/joints", "/arm/sensor", 1).replace("config: arm", "config: 3")
    assert codes(compile_text(text)) == ["OBK103", "OBK104", "OBK101", "OBK203"]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("/${NONE}/est".join(VALID_TEXT.split("/arm/est", 1)), "OBK011"),
        ("/${NONE}/est".join(VALID_TEXT.rsplit("/arm/est", 1)), "OBK011"),
        (VALID_TEXT + "? [a, b]\n: c\n", "OBK003"),
        (VALID_TEXT + "? {a: b}\n: c\n", "OBK003"),
        (VALID_TEXT + "'': c\n", "OBK003"),
    ],
)
def test_one_cause_is_reported_once(text: str, code: str) -> None:
    assert codes(compile_text(text)) == [code]


def test_a_file_with_null_is_empty() -> None:
    (fault,) = compile_text("~\n").diagnostics
    assert fault.message == "the file is empty"


def compile_files(files: dict[str, str]) -> list[str]:
    """The findings in `main.yaml`, whose files are all in memory."""

    def read(path: str) -> bytes | str:
        return files[path].encode() if path in files else "file not found"

    made = Options(variables={}, working_folder=Path.cwd(), ignore=("OBK2", "OBK4"), read=read)
    return [str(fault) for fault in compile_config("main.yaml", made).diagnostics]


def test_the_files_of_a_config_hold_only_so_many_values_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for module in (yaml_parser, loader):
        monkeypatch.setattr(module, "MOST_VALUES", 1_500)
    many = f"vars: [{', '.join('x' * 500)}]\n"
    parts = {"a": many, "b": many, "c": many, "d": many}
    assert compile_files({"main.yaml": "include: [a, b]\n", **parts}) == []
    (fault,) = compile_files({"main.yaml": "include: [a, b, c, d]\n", **parts})
    assert fault.startswith("c:1:")
    assert fault.endswith(
        "error[OBK006]: there are more than 1,500 values, including those of the previous files"
    )
    assert compile_files({"main.yaml": "include: [a, a, a, a]\n", **parts}) == []


def test_the_files_of_a_config_are_only_so_long_together() -> None:
    long = "#" * (LONGEST_FILE_BYTES // 2) + "\n"
    parts = {"a": f"vars: 1 {long}", "b": f"vars: 2 {long}", "c": "vars: 3\n"}
    assert compile_files({"main.yaml": "include: [a, a, c]\n", **parts}) == []
    assert compile_files({"main.yaml": "include: [a, b, c]\n", **parts}) == [
        "b:1:1: error[OBK007]: this file and those before it exceed 10 MiB, so it is not read"
    ]


@pytest.mark.parametrize(("letter", "is_too_long"), [("e", False), ("\u00e9", True)])
def test_the_bytes_of_a_config_count_and_not_its_letters(letter: str, is_too_long: bool) -> None:
    text = f"include: a\nvars: 1\n#{letter * (LONGEST_FILE_BYTES // 2 - 100)}\n"
    found = compile_files({"main.yaml": text, "a": "#" * (LONGEST_FILE_BYTES // 2)})
    assert any("OBK007" in fault for fault in found) == is_too_long


def test_a_file_named_like_the_standard_input_is_a_file() -> None:
    assert compile_files({"main.yaml": 'include: "-"\n', "./-": "vars: 1\n"}) == []
    (fault,) = compile_files({"main.yaml": 'include: "-"\n', "-": "vars: 1\n"})
    assert "included file `-` cannot be read: file not found" in fault


def test_only_so_many_files_are_included() -> None:
    parts = {f"p{number:03}": "vars: 1\n" for number in range(102)}
    assert compile_files({"main.yaml": f"include: [{', '.join(parts)}]\n", **parts}) == [
        "main.yaml:1:611: error[OBK007]: more than 100 files are included; `p100` and all later "
        "ones are ignored"
    ]


def test_of_a_file_without_end_only_so_much_is_read() -> None:
    (fault,) = compile_config("/dev/zero", options(Path.cwd())).diagnostics
    assert fault.code == "OBK007"


def test_a_missing_include_suggests_similar_files_and_hides_what_it_may_contain(
    tmp_path: Path,
) -> None:
    (tmp_path / "base.yaml").write_text("config: arm\n")
    (tmp_path / "variant.yaml").write_text(
        "include: base.yml\ncontrol:\n  pkg: obelisk_control_py\n"
        "  executable: example_position_setpoint_controller\n"
    )
    options = Options(variables={}, working_folder=tmp_path)
    outcome = compile_config(str(tmp_path / "variant.yaml"), options)
    assert [fault.code for fault in outcome.diagnostics if fault.severity != "info"] == ["OBK008"]
    assert outcome.diagnostics[0].help == "did you mean `base.yaml`?"


def test_a_missing_include_does_not_suggest_the_including_file(tmp_path: Path) -> None:
    (tmp_path / "variant.yaml").write_text("include: variant.yml\n")
    options = Options(variables={}, working_folder=tmp_path)
    outcome = compile_config(str(tmp_path / "variant.yaml"), options)
    (fault,) = (fault for fault in outcome.diagnostics if fault.code == "OBK008")
    assert fault.help is not None
    assert "did you mean" not in fault.help
