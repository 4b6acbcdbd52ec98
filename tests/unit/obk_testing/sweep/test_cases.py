"""The cases of a sweep depend only on the tests and the command line."""

from pathlib import Path

import pytest

from obk_cli.errors import MisuseError
from obk_testing.sweep.cases import (
    FoundTest,
    make_cases,
    parse_varied,
    with_types_of_config,
)

PUSH = FoundTest(node_id="tests/test_arm.py::test_push[8-seed0]", takes_seed=True)
STILL = FoundTest(node_id="tests/test_arm.py::test_still", takes_seed=False)
CONFIG = """\
config: tiny
control:
  pkg: some_py
  executable: controller
  params: {gain: 50.0, count: 3, mode: soft, gains: [1.0, 2.0]}
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.yaml"
    path.write_text(CONFIG)
    return path


@pytest.mark.parametrize(
    ("node_id", "name"),
    [
        ("t.py::test_push[seed0]", "t.py::test_push"),
        ("t.py::test_push[8-seed0]", "t.py::test_push[8]"),
        ("t.py::test_push[seed0-8]", "t.py::test_push[8]"),
        ("t.py::test_push[a-seed0-8]", "t.py::test_push[a-8]"),
        ("smoke[seed0]", "smoke"),
        ("t.py::TestArm::test_seed0[seed0]", "t.py::TestArm::test_seed0"),
    ],
)
def test_the_name_of_a_test_has_no_seed(node_id: str, name: str) -> None:
    found = FoundTest(node_id=node_id, takes_seed=True)
    assert found.name == name
    assert found.node_id_of(0) == node_id
    assert found.node_id_of(17).count("seed17") == 1


def test_a_test_without_a_seed_runs_once_for_each_point() -> None:
    cases = make_cases([PUSH, STILL], seeds=5)
    assert [case.seed for case in cases if case.test == PUSH.name] == [0, 1, 2, 3, 4]
    assert [case.seed for case in cases if case.test == STILL.name] == [None]
    assert len({case.key for case in cases}) == 6


def test_a_sample_has_one_value_in_each_part_of_the_range() -> None:
    varied = parse_varied("control.params.gain=50..200")
    cases = make_cases([PUSH], seeds=30, varied=[varied])
    values = sorted(float(dict(case.overrides)[varied.path]) for case in cases)
    assert len(cases) == 30
    for part, value in enumerate(values):
        assert 50 + 5 * part <= value <= 50 + 5 * (part + 1)


def test_two_samples_are_out_of_step_and_reproducible() -> None:
    varied = [parse_varied("a=0..1"), parse_varied("b=0..1")]
    cases = make_cases([PUSH], seeds=20, varied=varied)
    pairs = [[float(value) for _, value in case.overrides] for case in cases]
    assert sorted(pairs, key=lambda pair: pair[0]) != sorted(pairs, key=lambda pair: pair[1])
    assert cases == make_cases([PUSH], seeds=20, varied=varied)


def test_a_longer_sweep_of_seeds_has_the_cases_of_a_shorter_one() -> None:
    short, long = make_cases([PUSH], seeds=3), make_cases([PUSH], seeds=5)
    assert {case.key for case in short} < {case.key for case in long}


def test_a_grid_has_every_combination_with_every_seed() -> None:
    varied = [parse_varied("a=0..1:3"), parse_varied("b=soft,stiff")]
    cases = make_cases([PUSH], seeds=2, varied=varied, is_grid=True)
    points = {(case.seed, *(value for _, value in case.overrides)) for case in cases}
    assert points == {
        (seed, a, b) for seed in (0, 1) for a in ("0.0", "0.5", "1.0") for b in ("soft", "stiff")
    }


def test_a_grid_needs_the_number_of_values_of_a_range() -> None:
    with pytest.raises(MisuseError, match="a grid needs"):
        make_cases([PUSH], seeds=1, varied=[parse_varied("a=0..1")], is_grid=True)


def test_a_list_is_spread_over_the_samples() -> None:
    cases = make_cases([PUSH], seeds=6, varied=[parse_varied("a=x,y,z")])
    assert sorted(value for case in cases for _, value in case.overrides) == list("xxyyzz")


@pytest.mark.parametrize("text", ["gain", "=1..2", "gain=", "gain=1", "gain=2..1", "gain=1..2:0"])
def test_invalid_ranges_and_lists_are_rejected(text: str) -> None:
    with pytest.raises(MisuseError):
        parse_varied(text)


def test_integers_of_the_config_stay_integers(config: Path) -> None:
    gain, count = with_types_of_config(
        [parse_varied("control.params.gain=1..9"), parse_varied("control.params.count=1..9")],
        config,
        {},
    )
    assert gain.ends() == ("1.0", "9.0")
    assert count.ends() == ("1", "9")
    assert set(count.sample(50)) == {str(number) for number in range(1, 10)}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("control.params.gian=1..2", "gain"),
        ("contrl.params.gain=1..2", "control"),
        ("control.params.mode=1..2", "mode=A,B"),
        ("control.params.gains=1..2", r"gains\[0\]"),
        ("control.params.gains[2]=1..2", None),
        ("control.params.count=0.5..2", "decimal"),
        ("control.params=1..2", "NAME"),
    ],
)
def test_a_path_that_cannot_be_varied_is_rejected(
    config: Path, text: str, found: str | None
) -> None:
    with pytest.raises(MisuseError) as error:
        with_types_of_config([parse_varied(text)], config, {})
    assert found is None or found.replace("\\", "") in (error.value.help or "")


def test_an_element_of_a_list_can_be_varied(config: Path) -> None:
    with_types_of_config([parse_varied("control[0].params.gains[1]=1..2")], config, {})


def test_the_same_path_cannot_be_varied_twice(config: Path) -> None:
    varied = parse_varied("control.params.gain=1..2")
    with pytest.raises(MisuseError, match="twice"):
        with_types_of_config([varied, varied], config, {})


def test_the_number_of_values_in_a_range_is_only_for_a_grid() -> None:
    with pytest.raises(MisuseError, match="--grid"):
        parse_varied("a=1..2:3").sample(4)
