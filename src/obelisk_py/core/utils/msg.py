"""NumPy arrays to and from `FloatMultiArray` and `UInt8MultiArray`.

The layout is that of std_msgs/MultiArrayLayout: element (i, j, k) stands at
`data[data_offset + i*dim[1].stride + j*dim[2].stride + k]`, and `dim[n].stride` is the product of
`dim[n].size` and all sizes behind it.
"""

from array import array as PythonArray  # noqa: N812  (an argument is called array)
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obelisk_std_msgs.msg import FloatMultiArray, UInt8MultiArray
from std_msgs.msg import MultiArrayDimension, MultiArrayLayout

from obelisk_py.core.exceptions import ObeliskMsgError

__all__ = ["multiarray_from_numpy", "multiarray_to_numpy"]

DTYPES: dict[type[Any], np.dtype[Any]] = {
    FloatMultiArray: np.dtype(np.float64),
    UInt8MultiArray: np.dtype(np.uint8),
}


def multiarray_from_numpy(
    array: NDArray[Any], labels: tuple[str, ...] = ()
) -> FloatMultiArray | UInt8MultiArray:
    """A message that holds an array: `UInt8MultiArray` for bytes, else `FloatMultiArray`.

    Args:
        array: of any shape; real numbers.
        labels: names of the dimensions; without them they are empty.

    Raises:
        ObeliskMsgError: the elements are no real numbers, or the labels do not fit the shape.
    """
    if array.dtype.kind not in "fiub":
        raise ObeliskMsgError(f"an array of {array.dtype} cannot be put into a message")
    if labels and len(labels) != array.ndim:
        raise ObeliskMsgError(f"{len(labels)} labels for an array of {array.ndim} dimensions")
    message = UInt8MultiArray() if array.dtype == np.uint8 else FloatMultiArray()
    message.layout = MultiArrayLayout(
        dim=[
            MultiArrayDimension(
                label=labels[axis] if labels else "",
                size=size,
                stride=prod(array.shape[axis:]),
            )
            for axis, size in enumerate(array.shape)
        ]
    )
    # In this form rclpy keeps numbers as they are; a list it would convert one by one.
    elements = np.ascontiguousarray(array, DTYPES[type(message)])
    message.data = PythonArray(elements.dtype.char, elements.tobytes())
    return message


def multiarray_to_numpy(message: FloatMultiArray | UInt8MultiArray) -> NDArray[Any]:
    """The array that a message holds, as a copy.

    A message without dimensions gives a flat array of all its data.

    Returns:
        shape `(dim[0].size, dim[1].size, ...)`.

    Raises:
        ObeliskMsgError: the message has fewer data than its layout.
    """
    data: NDArray[Any] = np.array(message.data, DTYPES[type(message)])
    offset, dims = message.layout.data_offset, message.layout.dim
    if not dims:
        return data[offset:]
    shape = tuple(int(d.size) for d in dims)
    # The first stride is the whole array's length; between elements the inner ones count.
    steps = (*(int(d.stride) for d in dims[1:]), 1)
    last = sum((size - 1) * step for size, step in zip(shape, steps, strict=True))
    if 0 not in shape and offset + last >= data.size:
        raise ObeliskMsgError(
            f"the layout asks for {offset + last + 1} elements (offset {offset}, shape {shape}, "
            f"strides {steps}) and the message holds {data.size}"
        )
    if 0 in shape:
        return np.zeros(shape, data.dtype)
    view = np.lib.stride_tricks.as_strided(
        data[offset:], shape, tuple(step * data.itemsize for step in steps), writeable=False
    )
    return view.copy()
