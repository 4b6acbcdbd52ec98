"""Convert NumPy arrays to and from `FloatMultiArray` and `UInt8MultiArray`.

Element (i, j, k) is `data[data_offset + dim[0].stride*i + dim[1].stride*j + dim[2].stride*k]`: a
row-major array of shape (3, 4) has strides 4 and 1.
"""

from array import array as PythonArray  # noqa: N812  (an argument is called array)
from collections.abc import Sequence
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import MultiArrayDimension, MultiArrayLayout

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.messages import optional_message

__all__ = ["multiarray_to_np", "np_to_multiarray"]

FloatMultiArray: Any = optional_message("FloatMultiArray")
UInt8MultiArray: Any = optional_message("UInt8MultiArray")
DTYPES: dict[type[Any], np.dtype[Any]] = {
    FloatMultiArray: np.dtype(np.float64),
    UInt8MultiArray: np.dtype(np.uint8),
}


def np_to_multiarray(
    array: NDArray[Any], labels: tuple[str, ...] = ()
) -> FloatMultiArray | UInt8MultiArray:
    """Convert an array: uint8 to `UInt8MultiArray`, anything else to `FloatMultiArray`.

    Args:
        array: real numbers, of any shape.
        labels: names of the dimensions; empty if omitted.

    Raises:
        ObeliskMsgError: the elements are not real numbers, or the labels do not match the shape.
    """
    if array.dtype.kind not in "fiub":
        raise ObeliskMsgError(f"an array of {array.dtype} cannot be converted to a message")
    if labels and len(labels) != array.ndim:
        raise ObeliskMsgError(f"{len(labels)} labels for an array of {array.ndim} dimensions")
    message = UInt8MultiArray() if array.dtype == np.uint8 else FloatMultiArray()
    message.layout = MultiArrayLayout(
        dim=[
            MultiArrayDimension(
                label=labels[axis] if labels else "",
                size=size,
                stride=prod(array.shape[axis + 1 :]),
            )
            for axis, size in enumerate(array.shape)
        ]
    )
    # rclpy assigns this type as is; it converts a list element by element.
    elements = np.ascontiguousarray(array, DTYPES[type(message)])
    message.data = PythonArray(elements.dtype.char, elements.tobytes())
    return message


def multiarray_to_np(message: FloatMultiArray | UInt8MultiArray) -> NDArray[Any]:
    """Convert a message to an array, as a copy.

    A message without dimensions yields a flat array of all its data. If all strides are 0, because
    the sender did not set them, the array is row-major. The comment in
    std_msgs/MultiArrayLayout defines other strides, 12 and 4 for the shape (3, 4). They are
    accepted if they are unambiguous: each is at least the size of its dimension times the next
    stride (1 after the last), and the usual strides would exceed the data.

    Returns:
        Array of shape `(dim[0].size, dim[1].size, ...)`.

    Raises:
        ObeliskMsgError: the message has less data than its layout requires.
    """
    data: NDArray[Any] = np.array(message.data, DTYPES[type(message)])
    dims = message.layout.dim
    elements = data[message.layout.data_offset :]
    if not dims:
        return elements
    shape = tuple(int(dim.size) for dim in dims)
    if 0 in shape:
        return np.zeros(shape, data.dtype)
    strides = tuple(int(dim.stride) for dim in dims)
    if not any(strides):
        strides = tuple(prod(shape[axis + 1 :]) for axis in range(len(shape)))
    if prod(shape) > elements.size:
        raise ObeliskMsgError(
            f"the layout has {prod(shape)} elements (shape {shape}), but the message has "
            f"{elements.size} after the offset {message.layout.data_offset}"
        )
    enclosing = (*strides[1:], 1)
    if _extent(shape, strides) > elements.size:
        layers = zip(shape, strides, enclosing, strict=True)
        nests = all(outer >= size * inner for size, outer, inner in layers)
        if not nests or _extent(shape, enclosing) > elements.size:
            raise ObeliskMsgError(
                f"the layout requires {_extent(shape, strides)} elements (shape {shape}, strides "
                f"{strides}), but the message has {elements.size} after the offset "
                f"{message.layout.data_offset}"
            )
        strides = enclosing
    view = np.lib.stride_tricks.as_strided(
        elements, shape, tuple(stride * data.itemsize for stride in strides), writeable=False
    )
    return view.copy()


def _extent(shape: Sequence[int], strides: Sequence[int]) -> int:
    """Return the number of elements from the first to the last one of an array."""
    return sum((size - 1) * stride for size, stride in zip(shape, strides, strict=True)) + 1
