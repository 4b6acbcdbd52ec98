"""Reports of a sweep: sums, text, JSON and a page without a network."""

import json
import math
from html.parser import HTMLParser
from typing import Any

import pytest

from obk_testing.sweep.cases import Outcome, Row, SweepCase
from obk_testing.sweep.report import report_page
from obk_testing.sweep.summary import (
    Result,
    Summary,
    duration_text,
    summary_json,
    summary_text,
)

PATH = "control.params.gain"


def result(seed: int, outcome: Outcome = "passed", gain: str = "1.0", **metrics: float) -> Result:
    case = SweepCase(
        test="tests/test_arm.py::test_push[<b>]",
        node_id=f"tests/test_arm.py::test_push[<b>-seed{seed}]",
        seed=seed,
        overrides=((PATH, gain),),
    )
    why = "assert 1 < 0" if outcome == "failed" else ""
    return Result(case=case, row=Row(key=case.key, outcome=outcome, why=why, metrics=metrics))


def summary(*results: Result, count: int | None = None, notes: tuple[str, ...] = ()) -> Summary:
    return Summary(
        name="arm",
        config="arm.yaml",
        results=results,
        count=len(results) if count is None else count,
        varied=(PATH,),
        notes=notes,
        machine={"cpu": "Some CPU"},
        engine="local",
    )


SOME = summary(
    result(0, gain="1.0", worst=0.1),
    result(1, "failed", gain="2.0", worst=0.9),
    result(2, "died", gain="2.0"),
    result(3, "skipped", gain="3.0"),
    result(4, gain="2.0", worst=float("nan")),
    notes=("other bits",),
)


def test_a_sweep_has_passed_when_all_cases_have() -> None:
    assert summary(result(0), result(1, "skipped")).all_passed
    assert not summary(result(0), count=2).all_passed
    assert not SOME.all_passed


def test_bad_cases_are_those_that_failed_or_died() -> None:
    assert [each.case.seed for each in SOME.bad] == [2, 1]


def test_the_worst_cases_come_first_then_the_extremes_of_metrics() -> None:
    worst = SOME.worst()
    assert [each.case.seed for each, _ in worst] == [4, 2, 1, 0]
    assert "`worst` is nan" in worst[0][1]
    assert [reason for _, reason in worst[1:]] == ["died", "failed", "smallest `worst`"]


def test_values_that_are_not_finite_are_counted_and_listed() -> None:
    values = (float("nan"), 1.0, float("inf"), float("nan"), float("-inf"))
    some = summary(*(result(seed, x=value, y=value) for seed, value in enumerate(values)))
    page = Page(report_page(some))
    assert "NaN in 2 cases, infinite in 2 cases" in page.text
    assert "nan to nan" not in page.text
    assert [each.case.seed for each, _ in some.worst()] == [0, 1]
    only = summary(result(0, "failed", x=math.inf))
    assert "infinite in 1 case" in Page(report_page(only)).text
    (listed,) = only.worst()
    assert "failed" in listed[1]
    assert "`x` is inf" in listed[1]


def test_the_median_of_an_even_number_of_values_is_between_them() -> None:
    some = summary(*(result(seed, x=value) for seed, value in enumerate((1.0, 2.0, 4.0, 8.0))))
    assert "median 3, p95 7.4, max 8" in Page(report_page(some)).text


def test_few_values_have_a_part_each_and_skipped_cases_do_not_count() -> None:
    parts = SOME.parts("tests/test_arm.py::test_push[<b>]", PATH)
    assert [(part.label, part.passed, part.count) for part in parts] == [
        ("1.0", 1, 1),
        ("2.0", 1, 3),
        ("3.0", 0, 0),
    ]


def test_many_values_of_a_range_share_parts() -> None:
    many = summary(*(result(n, "failed" if n < 30 else "passed", str(n / 10)) for n in range(100)))
    parts = many.parts(many.results[0].case.test, PATH)
    assert len(parts) == 10
    assert sum(part.count for part in parts) == 100
    assert [part.passed > 0 for part in parts] == [False] * 3 + [True] * 7


def test_text_values_are_supported_too() -> None:
    words = summary(result(0, gain="soft"), result(1, "failed", gain="stiff"))
    parts = words.parts(words.results[0].case.test, PATH)
    assert [(part.label, part.passed) for part in parts] == [("soft", 1), ("stiff", 0)]


def test_the_text_names_the_command_for_a_failed_case() -> None:
    text = summary_text(SOME, "out/report.html")
    assert "2 of 4 passed, 1 skipped" in text
    assert "--set control.params.gain=2.0" in text
    assert "out/report.html" in text


def test_the_json_has_everything_for_programs() -> None:
    data: dict[str, Any] = summary_json(SOME, "report.html", "sweep.sqlite")
    assert json.loads(json.dumps(data)) == data
    assert (data["ok"], data["cases"], data["done"]) == (False, 5, 5)
    assert data["outcomes"] == {"passed": 2, "failed": 1, "died": 1, "skipped": 1}
    assert [each["seed"] for each in data["failed"]] == [2, 1]
    assert data["failed"][1]["metrics"] == {"worst": 0.9}


class Page(HTMLParser):
    """Checks that tags are closed in order, and collects attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += attrs
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += attrs

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("shown", [SOME, summary(count=3), summary(result(0))])
def test_the_page_is_whole_and_loads_nothing(shown: Summary) -> None:
    page = Page(report_page(shown))
    assert not [name for name, _ in page.attributes if name in ("src", "href", "onclick")]
    assert "url(" not in report_page(shown)
    assert "<b>" not in page.text or "[<b>" in page.text


def test_the_page_shows_failures_with_their_commands() -> None:
    page = Page(report_page(SOME))
    assert (
        "obk test arm.yaml --set control.params.gain=2.0 --again "
        "'tests/test_arm.py::test_push[<b>-seed1]'" in page.text
    )
    assert "assert 1 < 0" in page.text
    assert "other bits" in page.text
    assert "Some CPU" in page.text


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (72, "1 min 12 s"), (3725, "1 h 2 min")]
)
def test_durations_are_short(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text
