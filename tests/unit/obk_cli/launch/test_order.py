"""Orders of nodes by name."""

from obk_cli.launch.order import in_tier_order, section_of


def test_the_section_is_read_from_a_nodes_name() -> None:
    assert section_of("/arm/obelisk_estimation_0") == "estimation"
    assert section_of("/obelisk_control_fast_one") == "control"


def test_a_name_that_is_none_of_ours_has_no_section() -> None:
    assert section_of("/camera") is None
    assert section_of("/obelisk_dance_0") is None


def test_robot_first_and_strangers_last() -> None:
    nodes = ["/camera", "/obelisk_control_0", "/obelisk_robot_0", "/obelisk_estimation_0"]
    assert in_tier_order(nodes) == (
        "/obelisk_robot_0",
        "/obelisk_estimation_0",
        "/obelisk_control_0",
        "/camera",
    )
