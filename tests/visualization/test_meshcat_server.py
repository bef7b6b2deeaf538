import logging
import socket
from pathlib import Path

import pytest

from mirte_drake.errors import UserError
from mirte_drake.visualization.meshcat_server import local_meshcat


def listening(port) -> list[str]:
    """Addresses that this machine listens at on a port, as the kernel writes them."""
    found = []
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            address, _, number = local.partition(":")
            if state == "0A" and int(number, 16) == port:
                found.append(address)
    return found


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="there is no Linux kernel to ask")
def test_only_this_machine_can_reach_the_page():
    meshcat = local_meshcat()
    assert meshcat.web_url() == f"http://127.0.0.1:{meshcat.port()}"
    assert listening(meshcat.port()) == ["0100007F"]  # 127.0.0.1, and no other.


def test_a_port_can_be_chosen_and_one_that_is_taken_is_named():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"port {port} .*choose another"):
            local_meshcat(port)
    assert local_meshcat(port).port() == port


def test_it_does_not_announce_itself_and_leaves_the_log_as_it_was(caplog):
    log = logging.getLogger("drake")
    before = log.level
    with caplog.at_level(logging.INFO):
        local_meshcat()
    assert caplog.text == "" and log.level == before
