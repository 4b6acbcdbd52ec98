import pytest

from obelisk_spec.wording import with_article, with_number


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("hinge", "a `hinge`"),
        ("ellipsoid", "an `ellipsoid`"),
        ("ObkImu", "an `ObkImu`"),
        ("obelisk_control_msgs/PositionSetpoint", "an `obelisk_control_msgs/PositionSetpoint`"),
        ("UInt16", "a `UInt16`"),
    ],
)
def test_a_name_has_the_article_that_it_is_said_with(name: str, said: str) -> None:
    assert with_article(name) == said


def test_a_noun_is_in_the_plural_unless_it_is_one() -> None:
    assert [with_number(n, "node") for n in (0, 1, 2)] == ["0 nodes", "1 node", "2 nodes"]
