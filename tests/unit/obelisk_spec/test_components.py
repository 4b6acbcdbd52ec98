import pytest

from obelisk_spec.components import component_identity, component_spellings, standard_component


def test_the_parameter_and_the_key_name_one_component() -> None:
    assert component_identity("pub_ctrl_setting") == component_identity("pub_ctrl") == "pub_ctrl"


@pytest.mark.parametrize("name", ["pub_ctrl", "pub_ctrl_setting", "publisher_ctrl"])
def test_the_seeds_other_spelling_is_found(name: str) -> None:
    assert set(component_spellings(name)) == {
        "pub_ctrl",
        "pub_ctrl_setting",
        "publisher_ctrl",
        "publisher_ctrl_setting",
    }


def test_a_name_of_the_users_own_has_no_other_spelling() -> None:
    assert component_spellings("joystick_sub_setting") == ("joystick_sub", "joystick_sub_setting")


def test_the_base_classes_components_are_known_by_every_spelling() -> None:
    assert standard_component("subscriber_est") == "sub_est"
    assert standard_component("timer_ctrl_setting") == "timer_ctrl"
    assert standard_component("asdf") is None
