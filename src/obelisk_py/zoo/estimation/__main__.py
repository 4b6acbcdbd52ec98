"""Runs `JointEncodersPassthroughEstimator` as a process."""

from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_py.zoo.estimation.jointencoders_passthrough_estimator import (
    JointEncodersPassthroughEstimator,
)

spin_obelisk(None, JointEncodersPassthroughEstimator)
