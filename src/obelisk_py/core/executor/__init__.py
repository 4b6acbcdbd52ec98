"""The library's own rclpy executor, for nodes that run loops at 1 kHz.

`event_loop_executor` is what users see. It runs `worker`s (a thread and its epoll each), which call
the `handlers` of the nodes' entities. `rcl_listeners` lets the middleware signal them without the
interpreter lock; `waitset_thread` waits for what rcl has no listener for.
"""

from obelisk_py.core.executor.event_loop_executor import EventLoopExecutor

__all__ = ["EventLoopExecutor"]
