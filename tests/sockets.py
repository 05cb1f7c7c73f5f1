"""Where processes listen."""

import ipaddress

import psutil


def check_loopback(process):
    """All servers of a process and of its children can be reached from this machine only."""
    family = [process, *process.children(recursive=True)]
    served = [s for one in family for s in one.net_connections() if s.status == psutil.CONN_LISTEN]
    assert served
    hosts = {ipaddress.ip_address(one.laddr.ip.removeprefix("::ffff:")) for one in served}
    assert all(host.is_loopback for host in hosts), hosts
