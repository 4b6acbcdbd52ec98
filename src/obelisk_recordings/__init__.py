"""Read recordings as numpy arrays, without ROS, message packages or `obk`.

Both `obk_cli` and `obelisk_py` use this package, so that commands and nodes read recordings in the
same way. Users import it as `obelisk_py.recordings`.
"""
