"""An rclpy executor for nodes with loops at 1 kHz.

`event_loop_executor` is the public interface. Its `worker`s (a thread with an epoll each) call the
`handlers` of the nodes' entities. `rcl_listeners` lets the middleware signal the workers without
the GIL. `waitset_thread` waits for the entities for which rcl has no listener.
"""

from obelisk_py.core.executor.event_loop_executor import EventLoopExecutor

__all__ = ["EventLoopExecutor"]
