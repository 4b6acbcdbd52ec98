"""Local transport: what subscriptions of a run and taps of the tool share.

A subscription listens on a Unix socket in the private folder of the run, which is named after its
GID, and publishers connect to it. `folder` opens and checks sockets, `packets` is what goes over
them, and `inbox` puts packets and messages of DDS into the order of publishing.
"""
