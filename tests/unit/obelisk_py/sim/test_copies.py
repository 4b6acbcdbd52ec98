"""Copies from MuJoCo's memory into a message, for any order or type."""

import numpy as np
import pytest

from obelisk_py.core.sim.mujoco.sensors.kind import (
    copy_all,
    copy_blocks,
    copy_picked,
    quaternion_blocks,
    vector_blocks,
)


@pytest.fixture(params=[np.float64, np.float32])
def numbers(request):
    return np.zeros(4, request.param)


def _after(copy, source):
    """The content of a copy after the values have changed."""
    source[:] = np.arange(len(source)) + 10.0
    copy()


def test_an_array_is_copied_as_it_is_now(numbers):
    source = np.zeros(4)
    _after(copy_all(numbers, source), source)
    assert numbers.tolist() == [10.0, 11.0, 12.0, 13.0]


@pytest.mark.parametrize("index", [[2, 3, 4, 5], [5, 0, 3, 2]])
def test_elements_are_copied_in_the_order_of_their_index(numbers, index):
    source = np.zeros(6)
    _after(copy_picked(numbers, source, np.array(index)), source)
    assert numbers.tolist() == [10.0 + place for place in index]


def test_several_blocks_are_copied_together_each_to_its_position():
    numbers, source = np.zeros(7), np.zeros(7)
    _after(
        copy_blocks(
            (
                *vector_blocks(numbers[:3], source[4:]),
                *quaternion_blocks(numbers[3:], source[:4]),
            )
        ),
        source,
    )
    assert numbers.tolist() == [14.0, 15.0, 16.0, 11.0, 12.0, 13.0, 10.0]


def test_a_copy_of_no_blocks_does_nothing():
    copy_blocks(())()
