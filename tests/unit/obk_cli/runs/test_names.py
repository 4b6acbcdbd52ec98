"""The nodes that a name refers to."""

from obk_cli.runs.registry import in_tier_order, section_of, select_nodes, stack_nodes

KNOWN = ("/obelisk_robot_0", "/obelisk_control_0", "/left/obelisk_control_1", "/dummy")


def test_a_name_is_full_or_short_or_a_sections() -> None:
    assert select_nodes("/obelisk_control_0", KNOWN) == ("/obelisk_control_0",)
    assert select_nodes("obelisk_control_0", KNOWN) == ("/obelisk_control_0",)
    assert select_nodes("control_1", KNOWN) == ("/left/obelisk_control_1",)
    assert select_nodes("left/control_1", KNOWN) == ("/left/obelisk_control_1",)
    assert select_nodes("right/control_1", KNOWN) == ()
    assert select_nodes("control", KNOWN) == ("/obelisk_control_0", "/left/obelisk_control_1")
    assert select_nodes("dummy", KNOWN) == ("/dummy",)
    assert select_nodes("contrl", KNOWN) == ()


def test_the_state_node_is_no_node_of_the_stack() -> None:
    assert stack_nodes(KNOWN) == (
        "/obelisk_robot_0",
        "/left/obelisk_control_1",
        "/obelisk_control_0",
    )
    assert stack_nodes(("/b", "/a")) == ("/a", "/b")


def test_the_section_is_read_from_a_nodes_name() -> None:
    assert section_of("/arm/obelisk_estimation_0") == "estimation"
    assert section_of("/obelisk_control_fast_one") == "control"


def test_a_foreign_name_has_no_section() -> None:
    assert section_of("/camera") is None
    assert section_of("/obelisk_dance_0") is None


def test_robot_first_and_others_last() -> None:
    nodes = ["/camera", "/obelisk_control_0", "/obelisk_robot_0", "/obelisk_estimation_0"]
    assert in_tier_order(nodes) == (
        "/obelisk_robot_0",
        "/obelisk_estimation_0",
        "/obelisk_control_0",
        "/camera",
    )


def test_a_full_name_means_only_that_node_in_its_namespace() -> None:
    known = ("/obelisk_control_0", "/arm/obelisk_control_0")
    assert select_nodes("/obelisk_control_0", known) == ("/obelisk_control_0",)
    assert select_nodes("control_0", known) == known
