import json

from sarif_pydantic import Sarif

from obk_cli.diagnostics.diagnostic import Related, found
from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.report import report_github, report_json, report_sarif, report_text, summary

SOURCE = SourceFile.of("f.yaml", "a: 1\n\tb: xyz\nc:\n  - d\n")
FINDING = found(
    "OBK101",
    "no such key",
    Span.at(SOURCE, 2, 5, 3),
    help="remove it",
    related=[Related(message="see here", span=Span(SOURCE, 3, 1, 4, 6))],
)


def test_a_report_literally() -> None:
    assert report_text([FINDING], colour=False) == (
        "f.yaml:2:5: error[OBK101]: no such key\n"
        "  2 | \tb: xyz\n"
        "    | \t   ^^^\n"
        "  f.yaml:3:1: see here\n"
        "  3 | c:\n"
        "    | ^^\n"
        "  help: remove it"
    )


def test_an_info_is_one_line_unless_verbose() -> None:
    infos = [
        found("OBK204", f"nothing reads `/{name}`", Span.at(SOURCE, line, 1), help="remove it")
        for name, line in (("a", 1), ("b", 3))
    ]
    short = report_text([FINDING, *infos, FINDING], colour=False)
    block = report_text([FINDING], colour=False)
    assert short == (
        f"{block}\n\n"
        "f.yaml:1:1: info[OBK204]: nothing reads `/a`\n"
        "f.yaml:3:1: info[OBK204]: nothing reads `/b`\n\n"
        f"{block}"
    )
    assert report_text(infos, colour=False, verbose=True).splitlines()[1:5] == [
        "  1 | a: 1",
        "    | ^",
        "  help: remove it",
        "",
    ]


def test_values_can_neither_break_the_line_nor_reach_the_terminal() -> None:
    finding = found("OBK101", "no `a\nb`", Span.at(SOURCE, 1, 1), help="not \x1b[2J\u2028\u202e")
    headline, _, _, help = report_text([finding], colour=False).split("\n")
    assert headline == r"f.yaml:1:1: error[OBK101]: no `a\nb`"
    assert help == r"  help: not \u001b[2J\u2028\u202e"


def test_the_part_around_the_location_is_shown_of_a_long_line() -> None:
    source = SourceFile.of("f.yaml", f"{'a' * 300}xyz{'b' * 300}")
    finding = found("OBK101", "no such key", Span.at(source, 1, 301, 3))
    _, shown, mark = report_text([finding], colour=False).splitlines()
    assert len(shown) < 180
    assert shown[mark.index("^") : mark.rindex("^") + 1] == "xyz"
    assert shown.startswith("  1 | ...aaa")
    assert shown.endswith("bbb...")


def test_color_is_only_added() -> None:
    coloured = report_text([FINDING], colour=True)
    assert "\x1b[31merror[OBK101]\x1b[0m" in coloured
    for code in ("31", "2", "32", "0"):
        coloured = coloured.replace(f"\x1b[{code}m", "")
    assert coloured == report_text([FINDING], colour=False)


def test_a_long_line_is_cut() -> None:
    source = SourceFile.of("f", "x" * 500)
    text = report_text([found("OBK101", "m", Span.at(source, 1, 1, 500))], colour=False)
    assert max(len(line) for line in text.splitlines()) < 180


def test_the_summary_counts() -> None:
    warning = found("OBK208", "unused", Span.at(SOURCE, 1, 1))
    assert summary(["f"], [FINDING, warning, warning], colour=False) == "f: 1 error, 2 warnings"
    assert summary(["f", "g"], [], colour=False) == "2 files: no findings"


def test_json_has_every_location_with_its_end() -> None:
    report = json.loads(report_json(["f.yaml"], [FINDING]))
    assert report["counts"] == {"error": 1, "warning": 0, "info": 0}
    assert report["diagnostics"] == [
        {
            "code": "OBK101",
            "severity": "error",
            "message": "no such key",
            "path": "f.yaml",
            "line": 2,
            "column": 5,
            "end_line": 2,
            "end_column": 8,
            "help": "remove it",
            "fix": None,
            "related": [
                {
                    "message": "see here",
                    "path": "f.yaml",
                    "line": 3,
                    "column": 1,
                    "end_line": 4,
                    "end_column": 6,
                }
            ],
        }
    ]


FIXABLE = found(
    "OBK101",
    "no such key",
    Span.at(SOURCE, 2, 2),
    fix=[Edit(Span.at(SOURCE, 2, 2, 1), "x"), Edit(Span(SOURCE, 4, 1, 5, 1), "")],
)


def test_json_has_the_edits_of_a_safe_fix() -> None:
    report = json.loads(report_json(["f.yaml"], [FIXABLE]))
    assert report["diagnostics"][0]["fix"] == {
        "edits": [
            {
                "path": "f.yaml",
                "line": 2,
                "column": 2,
                "end_line": 2,
                "end_column": 3,
                "text": "x",
            },
            {
                "path": "f.yaml",
                "line": 4,
                "column": 1,
                "end_line": 5,
                "end_column": 1,
                "text": "",
            },
        ]
    }


def test_an_edit_of_a_last_line_without_an_end_stays_within_the_file() -> None:
    source = SourceFile.of("f.yaml", "a: 1\nb: 2")
    finding = found("OBK506", "m", Span.at(source, 2, 1), fix=[Edit(Span(source, 2, 1, 3, 1), "")])
    (edit,) = json.loads(report_json([], [finding]))["diagnostics"][0]["fix"]["edits"]
    assert (edit["end_line"], edit["end_column"]) == (2, 5)


def test_sarif_has_the_edits_of_a_safe_fix() -> None:
    (run,) = json.loads(report_sarif([FIXABLE, FINDING]))["runs"]
    fixed, other = run["results"]
    assert "fixes" not in other
    (fix,) = fixed["fixes"]
    assert fix["artifactChanges"] == [
        {
            "artifactLocation": {"uri": "f.yaml"},
            "replacements": [
                {
                    "deletedRegion": {
                        "startLine": 2,
                        "startColumn": 2,
                        "endLine": 2,
                        "endColumn": 3,
                    },
                    "insertedContent": {"text": "x"},
                },
                {
                    "deletedRegion": {
                        "startLine": 4,
                        "startColumn": 1,
                        "endLine": 5,
                        "endColumn": 1,
                    }
                },
            ],
        }
    ]
    assert fix["description"]["text"]
    Sarif.model_validate_json(report_sarif([FIXABLE]))


def test_github_gets_one_line_for_each_finding() -> None:
    assert report_github([FINDING]) == (
        "::error file=f.yaml,line=2,endLine=2,col=5,endColumn=8,title=OBK101::"
        "no such key%0Af.yaml:3:1: see here%0Ahelp: remove it"
    )
    source = SourceFile.of("a,b:c", "x")
    line = report_github([found("OBK204", "100%", Span.at(source, 1, 1))])
    assert line.startswith("::notice file=a%2Cb%3Ac,")
    assert line.endswith("::100%25")


def test_an_independent_reader_takes_the_sarif_log() -> None:
    log = Sarif.model_validate_json(report_sarif([FINDING]))
    (run,) = log.runs
    (result,) = run.results or []
    assert (log.version, result.rule_id, result.level) == ("2.1.0", "OBK101", "error")
    assert result.message.text == "no such key\nremove it"


def test_sarif_has_the_rules_and_every_location() -> None:
    spaced = found("OBK204", "unread", Span.at(SourceFile.of("/a b.yaml", "x"), 1, 1))
    log = json.loads(report_sarif([FINDING, spaced]))
    (run,) = log["runs"]
    assert log["version"] == "2.1.0"
    assert [rule["id"] for rule in run["tool"]["driver"]["rules"]] == ["OBK101", "OBK204"]
    first, second = run["results"]
    assert (first["ruleIndex"], first["level"]) == (0, "error")
    place = first["locations"][0]["physicalLocation"]
    assert place["artifactLocation"] == {"uri": "f.yaml"}
    assert place["region"] == {"startLine": 2, "startColumn": 5, "endLine": 2, "endColumn": 8}
    assert first["relatedLocations"][0]["message"] == {"text": "see here"}
    assert second["level"] == "note"
    assert second["locations"][0]["physicalLocation"]["artifactLocation"] == {
        "uri": "file:///a%20b.yaml"
    }
