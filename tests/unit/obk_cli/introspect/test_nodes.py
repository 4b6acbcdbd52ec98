"""A node as text."""

from obk_cli.introspect.nodes import NodeInfo, node_text

OWN = {"/arm/get_state": ("lifecycle_msgs/srv/GetState",)}
ASKED = {"/arm/list_parameters": ("rcl_interfaces/srv/ListParameters",)}


def seen(services: dict[str, tuple[str, ...]]) -> NodeInfo:
    return NodeInfo(node="/arm", publishes={}, subscribes={}, services=services)


def test_a_node_without_parameters_is_not_reported_as_silent() -> None:
    assert "  parameters: not reported" in node_text(seen(OWN))
    assert "  parameters: no answer" in node_text(seen(OWN | ASKED))


def test_services_for_parameters_are_counted() -> None:
    assert list(node_text(seen(OWN | ASKED)))[-1] == "  and 1 service for its parameters"
