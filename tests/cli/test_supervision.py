"""The process that starts a command ends it where the command cannot end itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

PROGRAM = """
import os, signal, sys, time
from fenicsrom.cli import supervision

def deaf():
    for number in supervision.WORDS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, supervision.WORDS)
    print(os.getpid(), flush=True)
    time.sleep(60.0)

def code():
    return 3

def killed():
    os.kill(os.getpid(), signal.SIGKILL)

supervision.main, supervision.PATIENCE = {0}, 0.3
sys.exit(supervision.run())
"""


def started(what: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-c", PROGRAM.replace("{0}", what)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_computation_that_heeds_no_signal_is_killed(
    number: signal.Signals, code: int, word: str
) -> None:
    with started("deaf") as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        begin = time.monotonic()
        process.send_signal(number)
        _, errors = process.communicate(timeout=10)
    assert process.returncode == code and errors.startswith(f"fenicsrom: {word}")
    assert 0.25 < time.monotonic() - begin < 5.0
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


@pytest.mark.parametrize(("what", "code"), [("code", 3), ("killed", 128 + signal.SIGKILL)])
def test_exit_code_is_that_of_the_computation(what: str, code: int) -> None:
    with started(what) as process:
        assert process.wait(10) == code


def test_computation_ends_with_the_process_that_started_it() -> None:
    with started("deaf") as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.kill()
        assert process.stdout.read() == ""  # until the other process has closed it, too
