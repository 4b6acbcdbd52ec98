"""`migrate_source`: changed text, unchanged text, reports."""

from pathlib import Path

import pytest

from obk_cli.configedit.migrate import Migrated, migrate_source
from obk_cli.configedit.spelling import Spelling
from obk_cli.diagnostics.source import SourceFile
from obk_cli.report import report_text

HERE = Path(__file__).parent


def migrate(text: str, to: Spelling = "key") -> Migrated:
    return migrate_source(SourceFile.of("c.yaml", text), to)


def reported(migrated: Migrated) -> str:
    return report_text((*migrated.faults, *migrated.kept), colour=False, verbose=True)


SEED = """\
# head
config: dummy   # name
onboard:  # the arm's computer
    # the loop
    control:
      -   pkg: "p"      # odd layout stays
          executable: 'e'

          publishers:
            - ros_parameter: "pub_ctrl_setting"  # sent
              topic: /u
          timers: [{ros_parameter: timer_ctrl_setting, timer_period_sec: 1e-3}]
          params:
            text: |
              first

                indented
    # sensing:
obk: {ignore: [OBK4]}  # tail
"""

KEY = """\
# head
config: dummy   # name
# the arm's computer
# the loop
control:
  -   pkg: "p"      # odd layout stays
      executable: 'e'

      publishers:
        - key: "pub_ctrl"  # sent
          topic: /u
      timers: [{key: timer_ctrl, timer_period_sec: 1e-3}]
      params:
        text: |
          first

            indented
# sensing:
obk: {ignore: [OBK4]}  # tail
"""


def test_only_level_and_names_change() -> None:
    migrated = migrate(SEED)
    assert migrated.text == KEY
    assert not migrated.kept


def test_a_migrated_text_is_not_changed_again() -> None:
    assert not migrate(KEY).is_changed


def test_back_again_only_the_comment_behind_the_device_has_moved() -> None:
    back = migrate(KEY, "seed").text
    moved = SEED.replace("onboard:  # the arm's", "# the arm's")
    moved = moved.replace("    # the loop\n", "# the loop\nonboard:\n")
    assert back.replace("  ", "") == moved.replace("  ", "").replace("    # sensing", "# sensing")
    assert migrate(back).text == KEY


@pytest.mark.parametrize("end", ["\r\n", "\r"])
def test_line_ends_stay(end: str) -> None:
    assert migrate(SEED.replace("\n", end)).text == KEY.replace("\n", end)


def test_a_last_line_without_an_end_is_kept() -> None:
    text = "onboard:\n  robot:\n    publishers:\n    - ros_parameter: a_setting"
    assert migrate(text).text == "robot:\n  publishers:\n  - key: a"


def test_tabs_in_comments_and_behind_values_stay() -> None:
    text = "onboard:\n  robot:\n    pkg: p\t# one\ttwo\n  # three\t\n    executable: e\n"
    assert migrate(text).text == "robot:\n  pkg: p\t# one\ttwo\n# three\t\n  executable: e\n"


@pytest.mark.parametrize(
    ("text", "to", "place"),
    [
        ("{onboard: {robot: {timers: [{ros_parameter: a_setting}]}}}\n", "key", "1:2"),
        ("onboard: {robot: {timers: [{ros_parameter: a_setting}]}}\n", "key", "1:1"),
        ("{robot: {timers: [{key: a}]}, obk: {}}\n", "seed", "1:2"),
    ],
)
def test_a_level_in_braces_is_kept_and_components_are_migrated(
    text: str, to: Spelling, place: str
) -> None:
    migrated = migrate(text, to)
    names = ("ros_parameter: a_setting", "key: a")
    assert migrated.text == text.replace(*(names if to == "key" else names[::-1]))
    (only,) = migrated.kept
    assert (str(only).startswith(f"c.yaml:{place}: info[migrate]"), bool(only.help)) == (True, True)


def test_a_key_that_names_the_same_component_is_sufficient() -> None:
    text = (
        "robot:\n  publishers:\n"
        "  - ros_parameter: pub_a_setting  # one\n    key: pub_a\n"
        "  - key: pub_b_setting\n    ros_parameter: pub_b_setting  # two\n    topic: /b\n"
        "  - {ros_parameter: pub_c_setting, key: pub_c}\n"
        "  - {key: pub_d, ros_parameter: pub_d_setting }\n"
        "  - ros_parameter: pub_e_setting\n    key: pub_e\n"
    )
    assert migrate(text).text == (
        "robot:\n  publishers:\n"
        "  - # one\n    key: pub_a\n"
        "  - key: pub_b_setting\n    # two\n    topic: /b\n"
        "  - {key: pub_c}\n"
        "  - {key: pub_d }\n"
        "  - key: pub_e\n"
    )


def test_a_name_that_would_read_as_no_text_is_quoted() -> None:
    text = "robot: {timers: [ros_parameter: true_setting]}\n"
    assert migrate(text).text == 'robot: {timers: [key: "true"]}\n'


def test_nodes_of_viz_are_migrated_and_sim_blocks_are_not() -> None:
    text = (
        "viz:\n  viz_nodes:\n  - subscribers: [{ros_parameter: sub_viz_est_setting}]\n"
        "robot:\n  sim:\n  - ros_parameter: mujoco_setting\n"
        "  params: {publishers: [{ros_parameter: x_setting}]}\n"
    )
    assert migrate(text).text == text.replace(
        "ros_parameter: sub_viz_est_setting", "key: sub_viz_est"
    )


def test_an_anchored_node_is_migrated_once() -> None:
    text = (
        "control:\n- &node\n  publishers: &pubs\n  - &p {ros_parameter: pub_a_setting, topic: /a}\n"
        "- <<: *node\n  name: two\n- publishers: *pubs\n- publishers: [*p]\n"
    )
    assert migrate(text).text == text.replace("ros_parameter: pub_a_setting", "key: pub_a")


def test_unmigrated_parts_are_reported_literally(request: pytest.FixtureRequest) -> None:
    migrated = migrate((HERE / "kept.yaml").read_text())
    assert not migrated.is_changed
    expected = HERE / "kept.txt"
    if request.config.getoption("--update-golden"):
        expected.write_text(reported(migrated) + "\n")
    assert reported(migrated) + "\n" == expected.read_text()


@pytest.mark.parametrize(
    ("text", "to", "message"),
    [
        (
            "onboard: {robot: {}}\noffboard: {control: {}}\n",
            "key",
            "2:1: info[migrate]: the device blocks are kept: the top level can hold one device, "
            "not 2",
        ),
        (
            "arm: {robot: {}}\n",
            "key",
            "1:1: info[migrate]: the device block is kept: sections at the top level belong to the "
            "device `onboard`",
        ),
        (
            "onboard: {robot: {}}\ncontrol: {}\n",
            "key",
            "2:1: info[migrate]: section `control` is outside the device",
        ),
        (
            "onboard: &all {robot: {}}\n",
            "key",
            "1:1: info[migrate]: the device block is kept: it has an anchor or a tag",
        ),
        (
            "onboard:\n  robot: {}\n  config: a\nconfig: b\n",
            "key",
            "1:1: info[migrate]: the device block is kept: `config` also occurs outside it",
        ),
        (
            "? onboard\n: {robot: {}}\n",
            "key",
            "1:3: info[migrate]: the device block is kept: it is written with an anchor or with "
            "`?`",
        ),
        (
            "onboard: {control: {}}\nrobot: {}\n",
            "seed",
            "1:1: info[migrate]: the sections are outside the device `onboard`",
        ),
        (
            "control: {}\nconfig: a\nrobot: {}\n",
            "seed",
            "2:1: info[migrate]: the sections are kept at the top level: `config` is between them",
        ),
    ],
)
def test_a_kept_level_is_reported(text: str, to: Spelling, message: str) -> None:
    migrated = migrate(text, to)
    assert not migrated.is_changed
    (only,) = migrated.kept
    assert str(only) == f"c.yaml:{message}"


@pytest.mark.parametrize("to", ["key", "seed"])
def test_included_files_are_named_and_the_level_waits_for_them(to: Spelling) -> None:
    migrated = migrate("include: [a.yaml, b.yaml]\nonboard:\n  robot:\n    pkg: p\n", to)
    places = [str(finding).split(":", 3)[1:3] for finding in migrated.kept]
    assert not migrated.is_changed
    assert places[:2] == [["1", "11"], ["1", "19"]]


def test_aliases_that_tie_places_together_leave_the_file_alone() -> None:
    text = (
        "control:\n- publishers: [&p {ros_parameter: pub_a_setting}]\n"
        "- publishers: [{<<: *p, key: b}]\n"
    )
    migrated = migrate(text)
    assert migrated.text == text
    assert "because of its anchors or its layout" in reported(migrated)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "OBK114"),
        ("# nothing\n", "OBK114"),
        ("~\n", "OBK114"),
        ("- a\n", "OBK114"),
        ("site_name: a\n", "OBK114"),
        ("a: [", "OBK003"),
        ("control: 1\ncontrol: 2\n", "OBK004"),
    ],
)
def test_a_text_that_is_no_config_is_rejected(text: str, fault: str) -> None:
    migrated = migrate(text)
    assert [finding.code for finding in migrated.faults] == [fault]
    assert migrated.text == text


def test_document_marks_stay_outside_the_device() -> None:
    text = "%YAML 1.2\n---\nrobot:\n  pkg: p\n# tail\n...\n"
    nested = "%YAML 1.2\n---\nonboard:\n  robot:\n    pkg: p\n# tail\n...\n"
    assert migrate(text, "seed").text == nested
    assert migrate(nested).text == text


def test_a_name_whose_comment_silences_findings_is_kept() -> None:
    text = (
        "robot:\n  subscribers:\n"
        "    - ros_parameter: sub_imuu_setting  # obk: ignore[OBK406]\n      key: sub_imuu\n"
        "    - ros_parameter: sub_b_setting  # any other comment\n      key: sub_b\n"
    )
    migrated = migrate(text)
    assert migrated.text.splitlines()[:4] == text.splitlines()[:4]
    assert [str(one.span) for one in migrated.kept] == ["c.yaml:3:22"]
    assert "sub_b_setting" not in migrated.text
