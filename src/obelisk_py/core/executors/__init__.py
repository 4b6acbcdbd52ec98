"""The library's own rclpy executor, for nodes that run loops at 1 kHz.

`executor` is what users see; behind it `engine` puts together lanes (a thread
and its epoll each) and a roster of runners (one per entity of the nodes).
"""

from obelisk_py.core.executors.executor import EventLoopExecutor

__all__ = ["EventLoopExecutor"]
