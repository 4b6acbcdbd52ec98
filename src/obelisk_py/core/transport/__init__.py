"""Local transport: messages between the processes of a run on one host, past DDS.

Each subscription that the library's executor runs listens on a Unix socket in the private folder of
the run, which is named after the subscription's GID. A publisher connects to the sockets of those
subscriptions that DDS has matched with it. While they, and the buffers of its own process, are all
that it has, it sends nothing through DDS.

`socket_folder` finds the folder, `dds_endpoints` asks DDS for GIDs, and `sender` is the publisher's
side. The subscription's is `executor.local_receiver`; packets and sockets, which the tools use too,
are in `obelisk_spec.local_transport`.
"""
