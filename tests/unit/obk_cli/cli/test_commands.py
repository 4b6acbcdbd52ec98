"""The `obk` command line: output streams and exit codes."""

import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from obk_cli.cli.commands import VERBS, root_command
from obk_cli.cli.launch import OPTION_GROUPS
from obk_cli.cli.main import main
from obk_cli.emit.formats import FORMS
from obk_cli.errors import CommandFailedError

CASES = Path(__file__).parents[3] / "cases"
VALID_CONFIG = CASES / "accept/OBK004/topic_twice.yaml"
FAULTY = CASES / "reject/OBK203/dangling.yaml"


class Result:
    """One run of `obk`."""

    def __init__(self, capsys: pytest.CaptureFixture[str], *arguments: str) -> None:
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        self.code = ended.value.code
        self.out, self.err = capsys.readouterr()


def test_help_names_every_command_and_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    result = Result(capsys, "--help")
    assert result.code == 0
    assert all(f"\n  {name} " in result.out for name in VERBS)
    assert "Example: obk" in result.out


@pytest.mark.parametrize(
    ("short", "long"),
    [
        (["-h"], ["--help"]),
        (["help"], ["--help"]),
        (["help", "graph"], ["graph", "--help"]),
        (["help", "topic", "echo"], ["topic", "echo", "--help"]),
        (["version"], ["--version"]),
    ],
    ids=" ".join,
)
def test_help_and_version_have_short_forms(
    capsys: pytest.CaptureFixture[str], short: list[str], long: list[str]
) -> None:
    result = Result(capsys, *short)
    assert (result.code, result.err) == (0, "")
    assert result.out == Result(capsys, *long).out


def test_a_picture_of_an_unknown_kind_is_misuse(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    output = tmp_path / "stack.bmp"
    assert Result(capsys, "graph", str(VALID_CONFIG), "--output", str(output)).code == 2
    assert not output.exists()


@pytest.mark.parametrize("verb", ["validate", "compile", "explain", "schema"])
def test_every_command_has_help_with_an_example(
    capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    result = Result(capsys, verb, "--help")
    assert result.code == 0
    assert f"Example: obk {verb}" in result.out


def test_the_help_of_launch_has_each_option_in_a_group(capsys: pytest.CaptureFixture[str]) -> None:
    root = root_command()
    launch = root.get_command(click.Context(root), "launch")
    options = sorted(p.opts[0] for p in launch.params if p.param_type_name == "option")
    grouped = [option for group in OPTION_GROUPS.values() for option in group]
    assert sorted(grouped) == sorted([*options, "--help"])
    lines = Result(capsys, "launch", "--help").out.splitlines()
    titles = [line.removesuffix(":") for line in lines if line.endswith(":") and line[0] != " "]
    assert titles == ["Arguments", *OPTION_GROUPS]


@pytest.mark.parametrize("verb", ["validate", "launch"])
def test_the_help_shows_how_a_value_is_set(capsys: pytest.CaptureFixture[str], verb: str) -> None:
    lines = Result(capsys, verb, "--help").out.splitlines()
    assert f"obk {verb} config.yaml --set 'robot[0].sim[0].time_step=0.001'" in {
        line.strip() for line in lines
    }


@pytest.mark.parametrize("verb", ["validate", "launch", "compile"])
def test_the_help_is_plain_text(capsys: pytest.CaptureFixture[str], verb: str) -> None:
    assert "\\[" not in Result(capsys, verb, "--help").out


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize(
    ("words", "unneeded"),
    [
        (
            ["topic", "echo", "--help"],
            {"rich", "yaml", "hashlib", "obk_cli.config.model", "obk_cli.launch.events"},
        ),
        (["ps", "--help"], {"obk_cli.ros.graph", "obk_cli.compiler", "obk_cli.launch.events"}),
        (["new", "controller", "--help"], {"obk_cli.compiler", "obk_cli.launch.commands"}),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_plain_help_imports_only_what_its_command_needs(
    words: list[str], unneeded: set[str]
) -> None:
    code = (
        "import sys\n"
        "from obk_cli.cli.main import main\n"
        f"try: main({words})\n"
        f"except SystemExit as ended: print(ended.code, {unneeded} & sys.modules.keys())\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.splitlines()[-1] == "0 set()"


def test_a_misspelled_command_is_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    result = Result(capsys, "valdate")
    assert result.code == 2
    assert result.out == ""
    assert result.err == ("error: unknown command `valdate`\n  help: did you mean `validate`?\n")


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("echo", "`obk topic echo`"),
        ("hz", "`obk topic hz`"),
        ("call", "`obk service call`"),
        ("activate", "`obk lifecycle activate`"),
        ("get", "`obk lifecycle get` or `obk param get`"),
        ("info", "`obk topic info`, `obk node info` or `obk bag info`"),
        ("run", "`obk launch`"),
        ("status", "`obk ps`"),
        ("replay", "`obk play`"),
    ],
)
def test_a_command_without_the_one_that_it_belongs_to_is_reported_with_it(
    capsys: pytest.CaptureFixture[str], word: str, meant: str
) -> None:
    result = Result(capsys, word, "est")
    assert (result.code, result.out) == (2, "")
    assert result.err == f"error: unknown command `{word}`\n  help: did you mean {meant}?\n"


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--timeout", "0", "a number of seconds above 0"),
        ("--hang-after", "-0.5", "seconds of at least 0"),
        ("--keep", "0", "a number of at least 1"),
        ("--duration", "-1", "seconds of at least 0"),
        ("--duration", "nan", "seconds of at least 0"),
    ],
)
def test_a_number_that_a_launch_cannot_use_is_the_only_one_reported_of(
    capsys: pytest.CaptureFixture[str], option: str, value: str, expected: str
) -> None:
    result = Result(capsys, "launch", str(VALID_CONFIG), option, value)
    assert (result.code, result.err) == (2, f"error: `{option} {value}`: expected {expected}\n")


@pytest.mark.parametrize(
    "error",
    [
        ImportError("initialization failed"),
        RuntimeError("cannot release un-acquired lock"),
        CommandFailedError("ROS 2 is not available"),
    ],
)
def test_an_interrupt_converted_to_an_error_by_a_library_is_still_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def interrupted(*_: object) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise error from None

    monkeypatch.setattr("obk_cli.cli.commands._load", interrupted)
    result = Result(capsys, "validate", str(VALID_CONFIG))
    assert (result.code, result.err) == (130, "")


def test_an_interruption_while_the_tool_is_being_imported_is_silent() -> None:
    code = (
        "import signal, sys\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name == 'typer':\n"
        "            signal.raise_signal(signal.SIGINT)\n"
        "from obk_cli.cli.main import main\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "main(['--help'])\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, b"", b"")


def test_validate_a_valid_config(capsys: pytest.CaptureFixture[str]) -> None:
    result = Result(capsys, "validate", str(VALID_CONFIG), "--ignore", "OBK4")
    assert (result.code, result.out) == (0, f"{VALID_CONFIG}: no findings\n")


def test_validate_a_faulty_config(capsys: pytest.CaptureFixture[str]) -> None:
    result = Result(capsys, "validate", str(FAULTY), "--ignore", "OBK4")
    assert result.code == 1
    assert result.out.startswith(f"{FAULTY}:25:16: error[OBK203]: nothing publishes `/arm/sensor`")
    assert result.out.endswith(f"\n{FAULTY}: 1 error\n")
    assert result.err == ""


def test_strict_fails_on_warnings(capsys: pytest.CaptureFixture[str]) -> None:
    warned = str(CASES / "reject/OBK208/unused.yaml")
    assert Result(capsys, "validate", warned, "--ignore", "OBK4").code == 0
    assert Result(capsys, "validate", warned, "--ignore", "OBK4", "--strict").code == 1


def test_several_files_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    result = Result(
        capsys, "validate", str(VALID_CONFIG), str(FAULTY), "--format", "json", "--ignore", "obk4"
    )
    report = json.loads(result.out)
    assert result.code == 1
    assert report["files"] == [str(VALID_CONFIG), str(FAULTY)]
    assert [d["code"] for d in report["diagnostics"]] == ["OBK203"]


def test_the_other_formats(capsys: pytest.CaptureFixture[str]) -> None:
    faulty = ("validate", str(FAULTY), "--ignore", "OBK4", "--format")
    assert json.loads(Result(capsys, *faulty, "sarif").out)["version"] == "2.1.0"
    assert Result(capsys, *faulty, "github").out.startswith(f"::error file={FAULTY},line=25,")
    sound = Result(capsys, "validate", str(VALID_CONFIG), "--ignore", "OBK4", "--format", "github")
    assert (sound.code, sound.out) == (0, "")


@pytest.mark.parametrize("form", ["text", "json", "sarif", "github"])
def test_a_file_with_a_name_of_invalid_utf8_is_checked_like_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    monkeypatch.chdir(tmp_path)
    name = os.fsdecode(b"b\xff.yaml")
    Path(name).write_text(FAULTY.read_text(encoding="utf-8"), encoding="utf-8")
    result = Result(capsys, "validate", name, "--format", form)
    assert result.code == 1
    assert ("b%FF.yaml" if form == "sarif" else r"b\udcff.yaml") in result.out
    if form in ("json", "sarif"):
        json.loads(result.out)


def test_the_diff_of_a_file_with_a_name_of_invalid_utf8_shows_its_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    monkeypatch.chdir(tmp_path)
    name = os.fsdecode(b"b\xff.yaml")
    Path(name).write_text(
        "onboard:\n  control:\n    - pkg: p\n      executable: e\n", encoding="utf-8"
    )
    with pytest.raises(SystemExit):
        main(["migrate", name, "--diff"])
    assert b"--- a/b\xff.yaml\n" in capfdbinary.readouterr().out


def test_standard_input(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"a: [")))
    result = Result(capsys, "validate", "-")
    assert result.code == 1
    assert result.out.startswith("<stdin>:1:4: error[OBK003]")


@pytest.mark.parametrize(
    ("line", "reported"),
    [
        ("validate f --format xml", "`--format xml`: expected one of `text`, `json`, `sarif`, "
         "`github`"),
        ("validate f --ignore OBK9", "`--ignore OBK9`: unknown rule\n"
            "  help: did you mean `OBK609`, `OBK429` or `OBK409`?"),
        ("validate f --color green", "`--color green`: expected `auto`, `always` or `never`"),
        ("compile f --to bmp", "`--to bmp`: expected one of `plan`, `params`, `launch`, "
         "`mermaid`, `dot`, `svg`, `json`"),
        ("migrate f --to new", "`--to new`: expected `key` or `seed`"),
        ("explain OBK20", "unknown rule `OBK20`\n"
            "  help: did you mean `OBK420`, `OBK320` or `OBK220`?"),
        ("new contoller foo", "unknown kind `contoller`\n  help: did you mean `controller`?"),
        ("new controller foo --device pc", "`--device` needs `--add-to CONFIG`"),
        ("new controller foo --add-to -", "`--add-to -`: expected a file"),
        ("build --workspace none", "`--workspace none`: folder not found"),
        ("build --jobs 0", "`--jobs 0`: expected a number of at least 1"),
        ("stop dummy --all", "`obk stop` takes RUN or `--all`, not both"),
        ("logs --lines -1", "`--lines`: expected a number of at least 0"),
        ("monitor", "`obk monitor` needs a terminal for input and output\n"
            "  help: without a terminal, use `obk monitor --once` or `obk monitor --format "
            "json`"),
        ("topic echo /est --format xml", "`--format xml`: expected `text`, `json` or `csv`"),
        ("topic echo /est --csv --format json", "`--csv` and `--format json` cannot be combined"),
        ("service call /s --type Trigger", "`--type Trigger`: expected a type such as"),
    ],
)  # fmt: skip
def test_misuse_is_reported_with_a_correction(
    capsys: pytest.CaptureFixture[str], line: str, reported: str
) -> None:
    result = Result(capsys, *line.split())
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith(f"error: {reported}")


@pytest.mark.parametrize(
    ("line", "reported"),
    [
        ("validate", "`obk validate` needs CONFIG...\n"
            "  help: usage: `obk validate [OPTIONS] CONFIG...`"),
        ("param set robot_0 kp", "`obk param set` needs VALUE\n"
            "  help: usage: `obk param set [OPTIONS] NODE NAME VALUE`"),
        ("launch x.yaml --durations 3", "`obk launch` has no option `--durations`\n"
            "  help: did you mean `--duration` or `--sim-duration`?"),
        ("validate --zzz f", "`obk validate` has no option `--zzz`\n"
            "  help: usage: `obk validate [OPTIONS] CONFIG...`"),
        ("launch x.yaml -o", "`obk launch` has no option `-o`\n"
            "  help: usage: `obk launch [OPTIONS] CONFIG`"),
        ("--zzz", "`obk` has no option `--zzz`\n"
            "  help: usage: `obk [OPTIONS] COMMAND [ARGS]...`"),
        ("ps extra", "got unexpected extra argument (extra)\n"
            "  help: usage: `obk ps [OPTIONS]`"),
        ("launch x.yaml --duration abc", "`--duration`: `abc` is not a valid float"),
        ("launch x.yaml --duration", "option `--duration` requires an argument"),
        ("param dmp", "unknown command `obk param dmp`\n"
            "  help: did you mean `dump`?"),
    ],
)  # fmt: skip
def test_a_command_line_of_another_form_is_reported_in_the_same_style(
    capsys: pytest.CaptureFixture[str], line: str, reported: str
) -> None:
    result = Result(capsys, *line.split())
    assert (result.code, result.out) == (2, "")
    assert result.err == f"error: {reported}\n"


def test_color_is_for_terminals_or_on_demand(capsys: pytest.CaptureFixture[str]) -> None:
    assert "\x1b" not in Result(capsys, "validate", str(FAULTY)).out
    assert "\x1b" in Result(capsys, "validate", str(FAULTY), "--color", "always").out


def test_compile_to_a_plan(capsys: pytest.CaptureFixture[str]) -> None:
    result = Result(
        capsys, "compile", str(VALID_CONFIG), "--ignore", "OBK4", "--set", "config=other"
    )
    plan = json.loads(result.out)
    assert result.code == 0
    assert plan["name"] == "other"
    assert [p["node"] for p in plan["processes"]] == [
        "obelisk_control_0",
        "obelisk_estimation_0",
        "obelisk_robot_0",
    ]


@pytest.mark.parametrize("form", FORMS)
def test_compile_into_a_folder_names_the_file_by_the_stack(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, form: str
) -> None:
    arguments = ("compile", str(VALID_CONFIG), "--ignore", "OBK4", "--to", form)
    printed = Result(capsys, *arguments)
    written = Result(capsys, *arguments, "--output", f"{tmp_path}/new/")
    assert (printed.code, written.code, written.out) == (0, 0, "")
    (path,) = (tmp_path / "new").iterdir()
    assert path.name == f"arm{FORMS[form].ending}"
    assert path.read_text() == printed.out


def test_compile_to_a_missing_folder_fails(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    result = Result(
        capsys,
        "compile",
        str(VALID_CONFIG),
        "--ignore",
        "OBK4",
        "--output",
        f"{tmp_path}/file/x.json",
    )
    assert result.code == 1
    assert "cannot be written" in result.err


def test_compile_of_a_faulty_config_reports_why_on_stderr(
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = Result(capsys, "compile", str(FAULTY), "--ignore", "OBK4")
    assert (result.code, result.out) == (1, "")
    assert "OBK203" in result.err


def test_explain(capsys: pytest.CaptureFixture[str]) -> None:
    result = Result(capsys, "explain", "obk203")
    assert result.code == 0
    assert result.out.startswith("OBK203 (error): a subscriber without a publisher\n")
    assert "OBK506" in Result(capsys, "explain").out


def test_an_internal_error_is_reported_as_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr("obk_cli.cli.validate.compile_config", fail)
    result = Result(capsys, "validate", str(VALID_CONFIG))
    assert result.code == 1
    assert "this is a bug in obk (RuntimeError: boom)" in result.err
    assert "Traceback" not in result.err
    trace = Path(result.err.rpartition(" ")[2].strip())
    assert "boom" in trace.read_text()
    trace.unlink()


@pytest.mark.parametrize("arguments", [["schema"], ["explain", "OBK303"], ["--help"]])
def test_a_closed_pipe_is_reported_as_if_by_its_signal(arguments: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "obk_cli.cli.main", *arguments]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")


METAVARS = {"duration": "SECONDS", "timeout": "SECONDS", "run": "RUN", "device": "NAME"}
METAVARS |= {"dest": "DIR", "templates": "DIR"}


def test_options_of_one_kind_have_one_metavar() -> None:
    with click.Context(root_command()) as context:
        commands = all_commands(context.command, context)
        for command in commands:
            for option in command.params:
                if isinstance(option, click.Option) and option.name in METAVARS:
                    assert option.metavar == METAVARS[option.name], (command.name, option.name)
                if option.name == "format" and not isinstance(option.metavar, str):
                    pytest.fail(f"{command.name} --format")


def all_commands(command: click.Command, context: click.Context) -> Iterator[click.Command]:
    yield command
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from all_commands(inner, click.Context(inner, parent=context))
