"""Whose a connection within this host is."""

import os
import socket

import pytest

from obk_cli.adapters.connections import user_of_connection


@pytest.mark.parametrize("family", [socket.AF_INET, socket.AF_INET6])
def test_a_connection_is_of_the_user_whose_process_made_it(family: socket.AddressFamily) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(family) as client:
        port = server.getsockname()[1]
        mapped = family is socket.AF_INET6
        try:
            client.connect(("::ffff:127.0.0.1" if mapped else "127.0.0.1", port))
        except OSError:
            pytest.skip("this machine has no IPv6")
        accepted, address = server.accept()
        with accepted:
            assert user_of_connection(address, port) == os.geteuid()
            assert user_of_connection(address, port + 1) is None
            client.close()
            # Nobody is to pass for root, whom the kernel names for what nobody has any more.
            assert user_of_connection(address, port) is None
