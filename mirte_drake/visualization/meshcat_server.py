"""A Meshcat that only this machine can reach."""

import logging

from pydrake.geometry import Meshcat, MeshcatParams

from mirte_drake.errors import UserError

HOST = "127.0.0.1"


def local_meshcat(port: int | None = None, *, show_rate: bool = False) -> Meshcat:
    """Returns a Meshcat that serves on the loopback interface alone.

    Args:
        port: Where; None: the first free one from 7000 on.
        show_rate: Whether its page has a plot of the realtime rate.

    Raises:
        UserError: when the port is taken.
    """
    params = MeshcatParams(host=HOST, port=port, show_stats_plot=show_rate)
    drake_log = logging.getLogger("drake")
    level = drake_log.level
    drake_log.setLevel(logging.WARNING)  # It would announce its address, also where nobody asked.
    try:
        return Meshcat(params)
    except RuntimeError as error:
        where = f"port {port} of {HOST}" if port else f"ports 7000 to 7999 of {HOST}"
        raise UserError(f"{where}: not free for the page: {error}; choose another") from None
    finally:
        drake_log.setLevel(level)
