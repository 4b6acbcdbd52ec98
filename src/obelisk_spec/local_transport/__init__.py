"""Local transport: what subscriptions of a run and taps of the tool share.

A subscription listens on a Unix socket in the private folder of the run, which is named after its
GID, and publishers connect to it. `sockets` opens and checks them and has the packets that they
carry, `dds_reader` takes messages of DDS, and `inbox` puts both into the order of publishing.
"""
