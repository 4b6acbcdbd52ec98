"""Truncated, changed or invented models are read or rejected, and never crash the process."""

import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.config.environment import ModelRead
from obk_cli.scaffold.stack import read_model_text
from obk_cli.workspace.model_reader import mjcf_elements, mjcf_files, read_model_bounded

from .hostile import damaged

pytestmark = pytest.mark.mujoco

ROOT = Path(__file__).parents[2]
MODELS = (ROOT / "examples/dummy/dummy.xml", ROOT / "examples/quadruped/model/quadruped.xml")
NAMES = tuple("abcd")
ODD_VALUES = (
    *("-1", "0", "1e400", "nan", "inf", "99999999999", "1 2", "", " ", "../..", "/dev/zero", "%s"),
    *("a" * 500, "\x7f", "0 0 0 0", "true", "world", "ball", "mesh", "user", "x y z"),
)
ODD_ELEMENTS = (
    '<include file="m.xml"/>',
    '<replicate count="3"><geom size="1"/></replicate>',
    "<frame><frame><body/></frame></frame>",
    '<sensor><user dim="-1"/></sensor>',
    '<sensor><jointpos joint="none"/></sensor>',
    '<keyframe><key qpos="1 2 3"/></keyframe>',
    '<default><default class="main"/></default>',
    '<equality><weld body1="a" body2="a"/></equality>',
    '<tendon><spatial><site site="s"/></spatial></tendon>',
    '<actuator><muscle joint="j"/></actuator>',
    '<asset><mesh name="m" vertex="0 0 0"/></asset>',
    '<asset><hfield name="h" nrow="-1" ncol="2" size="1 1 1 1"/></asset>',
    '<contact><pair geom1="a" geom2="b"/></contact>',
    '<custom><numeric name="n" size="-5" data="1"/></custom>',
    '<extension><plugin plugin="mujoco.none"/></extension>',
    '<size memory="-1"/>',
    '<option timestep="0" integrator="none"/>',
    '<flex name="f" dim="3"/>',
)


def look_at(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "m.xml")
        path.write_bytes(data)
        read = read_model_bounded(path)
        assert isinstance(read, ModelRead) or read.message
        list(mjcf_elements(path))
        list(mjcf_files(path))
        read_model_text(data.decode(errors="replace"), "m.xml")


@given(damaged([path.read_bytes() for path in MODELS]) | st.binary())
def test_a_damaged_model_is_read_or_rejected(data: bytes) -> None:
    look_at(data)


@given(
    st.sampled_from([path.read_text() for path in MODELS]),
    st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.sampled_from(ODD_VALUES + ODD_ELEMENTS)),
        min_size=1,
        max_size=4,
    ),
)
def test_no_value_and_no_element_of_a_model_is_too_odd(
    text: str, changes: list[tuple[float, str]]
) -> None:
    for part, odd in changes:
        mark = ">" if odd.startswith("<") else '="'
        places = text.split(mark)
        at = 1 + int(part * (len(places) - 1))
        if at < len(places):
            rest = places[at] if mark == ">" else places[at][places[at].find('"') :]
            places[at] = odd + rest
        text = mark.join(places)
    look_at(text.encode())


@given(
    st.dictionaries(
        st.sampled_from(NAMES),
        st.lists(st.sampled_from([*NAMES, "./a", "../b", "sub/../c", "none", "/dev/zero", ""])),
        min_size=1,
    ),
    st.booleans(),
)
def test_models_that_include_one_another_are_walked_once(
    included: dict[str, list[str]], is_attached: bool
) -> None:
    tag = "model" if is_attached else "include"
    with tempfile.TemporaryDirectory() as folder:
        for name, files in included.items():
            places = "".join(f'<{tag} file="{file}"/>' for file in files)
            Path(folder, name).write_text(f'<mujoco>{places}<geom name="{name}"/></mujoco>')
        first = Path(folder, min(included))
        files = [os.path.realpath(file) for file in mjcf_files(first)]
        assert len({*files}) == len(files)
        elements = [element.name for element in mjcf_elements(first)]
        assert len({*elements}) == len(elements)
