"""Read recordings as numpy arrays, without ROS: `open_run("dummy")["/robot/est"].q_joints`."""

from obelisk_recordings.bag import RecordingError
from obelisk_recordings.run import RecordedRun, open_run
from obelisk_recordings.topic import RecordedField, RecordedSignal, RecordedTopic

__all__ = [
    "RecordedField",
    "RecordedRun",
    "RecordedSignal",
    "RecordedTopic",
    "RecordingError",
    "open_run",
]
