"""Arrays in messages, with the layout of std_msgs/MultiArrayLayout."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from obelisk_std_msgs.msg import FloatMultiArray, UInt8MultiArray

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.utils.msg import multiarray_from_numpy, multiarray_to_numpy


@given(arrays(np.float64, array_shapes(max_dims=4, max_side=5), elements=st.floats(-9, 9)))
def test_an_array_comes_back_equal(array: NDArray[np.float64]) -> None:
    np.testing.assert_array_equal(multiarray_to_numpy(multiarray_from_numpy(array)), array)


def test_strides_are_products_of_the_sizes_behind() -> None:
    message = multiarray_from_numpy(np.zeros((3, 4, 5)), ("a", "b", "c"))
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == [
        ("a", 3, 60),
        ("b", 4, 20),
        ("c", 5, 5),
    ]


def test_bytes_make_a_byte_message_and_the_rest_floats() -> None:
    assert isinstance(multiarray_from_numpy(np.zeros(3, np.uint8)), UInt8MultiArray)
    assert isinstance(multiarray_from_numpy(np.zeros(3, np.int32)), FloatMultiArray)


def test_an_offset_and_padded_rows_are_honoured() -> None:
    message = multiarray_from_numpy(np.zeros((2, 2)))
    message.layout.data_offset = 1
    message.layout.dim[1].stride = 3
    message.data = [float(n) for n in range(8)]
    np.testing.assert_array_equal(multiarray_to_numpy(message), [[1, 2], [4, 5]])


def test_a_layout_longer_than_the_data_is_rejected() -> None:
    message = multiarray_from_numpy(np.zeros((2, 2)))
    message.data = [0.0, 1.0, 2.0]
    with pytest.raises(ObeliskMsgError, match=r"asks for 4 elements .* holds 3"):
        multiarray_to_numpy(message)


def test_a_message_without_dimensions_is_flat() -> None:
    message = FloatMultiArray(data=[1.0, 2.0])
    np.testing.assert_array_equal(multiarray_to_numpy(message), [1.0, 2.0])


def test_what_is_no_number_and_labels_that_do_not_fit_are_rejected() -> None:
    with pytest.raises(ObeliskMsgError, match="complex"):
        multiarray_from_numpy(np.zeros(2, np.complex128))
    with pytest.raises(ObeliskMsgError, match="1 labels for an array of 2 dimensions"):
        multiarray_from_numpy(np.zeros((2, 2)), ("a",))
