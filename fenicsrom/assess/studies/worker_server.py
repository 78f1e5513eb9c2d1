"""Imports of the server process of `fenicsrom.assess.jobs`; no other module imports this one.

The server and the processes that it forks ignore SIGTERM, which batch systems send to all
processes: the process that started them ends them.
"""

import signal

import fenicsrom.assess.studies.sweep_runs  # noqa: F401

signal.signal(signal.SIGTERM, signal.SIG_IGN)
