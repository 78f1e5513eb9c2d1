"""SIGINT and SIGTERM are noted while a command computes, and afterwards are what they were."""

import os
import signal

import pytest
from support import fresh_python

from fenicsrom.cli.termination import is_stopped, is_terminated, terminable


def test_sigterm_is_noted_and_does_not_end_the_process() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with terminable():
        assert not is_stopped()
        os.kill(os.getpid(), signal.SIGTERM)
        assert is_stopped() and is_terminated()
    assert signal.getsignal(signal.SIGTERM) is before


def test_sigint_raises_once_for_one_request() -> None:
    before = signal.getsignal(signal.SIGINT)
    with terminable():
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)  # the same request, sent to the whole process group
        assert is_stopped() and not is_terminated()
    assert signal.getsignal(signal.SIGINT) is before


def test_second_sigterm_after_a_while_ends_the_process() -> None:
    script = (
        "import os, signal, time\n"
        "from fenicsrom.cli import termination\n"
        "termination.REPEATED = 0.05\n"
        "with termination.terminable():\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    time.sleep(0.2)\n"
        "    print('alive', flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    print('survived', flush=True)\n"
    )
    assert fresh_python(script, code=-signal.SIGTERM).stdout == "alive\n"
