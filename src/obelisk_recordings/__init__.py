"""Read recordings as numpy arrays: no ROS, no message packages, no `obk` needed.

Below `obk_cli` and `obelisk_py`, so that the commands and the nodes' library read them alike.
Users import it as `obelisk_py.recordings`.
"""
