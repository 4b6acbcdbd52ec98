"""Local transport: what subscriptions of a run and taps of the tool share.

A subscription listens on a Unix socket in the private folder of the run, which is named after its
GID, and publishers connect to it. `folder` opens and checks sockets, `packets` is what goes over
them, `dds_reader` takes messages of DDS, and `inbox` puts both into the order of publishing.
"""
