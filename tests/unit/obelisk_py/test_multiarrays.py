"""Arrays in messages: the strides are a contract with all other readers and writers."""

from math import prod

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from obelisk_std_msgs.msg import FloatMultiArray, UInt8MultiArray

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.utils.msg import multiarray_to_np, np_to_multiarray

SHAPES = array_shapes(min_dims=1, max_dims=4, max_side=5)


@given(arrays(np.float64, SHAPES, elements=st.floats(-9, 9)), st.integers(0, 7))
def test_an_array_round_trips_in_both_forms(array: NDArray[np.float64], offset: int) -> None:
    message = np_to_multiarray(array)
    message.layout.data_offset = offset
    message.data = [-1.0] * offset + [*message.data]
    np.testing.assert_array_equal(multiarray_to_np(message), array)
    for axis, dim in enumerate(message.layout.dim):
        dim.stride = prod(array.shape[axis:])
    np.testing.assert_array_equal(multiarray_to_np(message), array)


@given(arrays(np.uint8, SHAPES), st.data())
def test_every_element_is_at_the_position_of_the_contract(
    array: NDArray[np.uint8], draw: st.DataObject
) -> None:
    index = draw.draw(st.tuples(*(st.integers(0, size - 1) for size in array.shape)))
    message = np_to_multiarray(array)
    place = sum(dim.stride * i for dim, i in zip(message.layout.dim, index, strict=True))
    assert message.data[message.layout.data_offset + place] == array[index]


@given(st.lists(st.integers(1, 3), min_size=1, max_size=3), st.data())
def test_layouts_that_the_contract_allows_are_read(shape: list[int], draw: st.DataObject) -> None:
    strides = draw.draw(st.tuples(*(st.integers(0, 9) for _ in shape)).filter(any))
    message = np_to_multiarray(np.zeros(shape))
    for dim, stride in zip(message.layout.dim, strides, strict=True):
        dim.stride = stride
    message.data = [float(n) for n in range(9 * sum(shape) + 1)]
    read = multiarray_to_np(message)
    for index in np.ndindex(*shape):
        assert read[index] == sum(s * i for s, i in zip(strides, index, strict=True))


def test_labels_sizes_and_strides() -> None:
    message = np_to_multiarray(np.zeros((3, 4, 5)), ("a", "b", "c"))
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == [
        ("a", 3, 20),
        ("b", 4, 5),
        ("c", 5, 1),
    ]


def test_bytes_make_a_byte_message_and_the_rest_floats() -> None:
    assert isinstance(np_to_multiarray(np.zeros(3, np.uint8)), UInt8MultiArray)
    assert isinstance(np_to_multiarray(np.zeros(3, np.int32)), FloatMultiArray)


@pytest.mark.parametrize("strides", [(3, 1), (6, 3)])
def test_an_offset_and_padded_rows_are_respected(strides: tuple[int, int]) -> None:
    message = np_to_multiarray(np.zeros((2, 2)))
    message.layout.data_offset = 1
    for dim, stride in zip(message.layout.dim, strides, strict=True):
        dim.stride = stride
    message.data = [float(n) for n in range(8)]
    np.testing.assert_array_equal(multiarray_to_np(message), [[1, 2], [4, 5]])


@pytest.mark.parametrize("strides", [(2, 1), (4, 2), (4, 3), (9, 9)])
def test_a_layout_longer_than_the_data_is_rejected(strides: tuple[int, int]) -> None:
    message = np_to_multiarray(np.zeros((2, 2)))
    for dim, stride in zip(message.layout.dim, strides, strict=True):
        dim.stride = stride
    message.data = [0.0, 1.0, 2.0]
    with pytest.raises(ObeliskMsgError, match=r"elements .* has 3"):
        multiarray_to_np(message)


@given(arrays(np.float64, SHAPES, elements=st.floats(-9, 9)))
def test_an_array_with_unset_strides_is_row_major(array: NDArray[np.float64]) -> None:
    message = np_to_multiarray(array)
    for dim in message.layout.dim:
        dim.stride = 0
    np.testing.assert_array_equal(multiarray_to_np(message), array)
    message.data = message.data[:-1]
    with pytest.raises(ObeliskMsgError):
        multiarray_to_np(message)


@pytest.mark.parametrize("strides", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_a_layout_with_more_elements_than_the_data_is_rejected(strides: tuple[int, int]) -> None:
    message = np_to_multiarray(np.zeros((2, 2)))
    for dim, stride in zip(message.layout.dim, strides, strict=True):
        dim.size, dim.stride = 2**31 if stride == 0 else 2, stride
    message.data = [0.0, 1.0, 2.0]
    with pytest.raises(ObeliskMsgError):
        multiarray_to_np(message)


def test_a_message_without_dimensions_is_flat() -> None:
    message = FloatMultiArray(data=[1.0, 2.0])
    np.testing.assert_array_equal(multiarray_to_np(message), [1.0, 2.0])


def test_an_axis_without_elements_has_no_data() -> None:
    assert multiarray_to_np(np_to_multiarray(np.zeros((3, 0)))).shape == (3, 0)


def test_values_that_are_no_numbers_and_mismatched_labels_are_rejected() -> None:
    with pytest.raises(ObeliskMsgError, match="complex"):
        np_to_multiarray(np.zeros(2, np.complex128))
    with pytest.raises(ObeliskMsgError, match="1 labels"):
        np_to_multiarray(np.zeros((2, 2)), ("a",))
