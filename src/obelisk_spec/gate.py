"""The gate between a launcher and the nodes that it starts early: no node is made before it opens.

A variable of the environment names a file. The launcher holds an exclusive lock (flock) on it while
it makes sure that nobody else has the stack's names and its robot; a program waits for a shared
one. The lock goes with the launcher, whatever ends it.
"""

__all__ = ["GATE_VARIABLE"]

GATE_VARIABLE = "OBK_GATE"
