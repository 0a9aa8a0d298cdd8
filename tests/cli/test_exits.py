import signal
import threading

import pytest

from mlivr_gym.cli.exits import handle_interrupts
from mlivr_gym.errors import MlivrError


@pytest.fixture(autouse=True)
def interrupts_are_not_ignored():
    """A shell that starts the tests in the background makes them ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupted_then(error):
    """A library that makes another error of an interruption."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise error from None


def test_an_interruption_stays_one_whatever_a_library_makes_of_it():
    with pytest.raises(KeyboardInterrupt), handle_interrupts():
        signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), handle_interrupts():
        interrupted_then(RuntimeError("no compiled object yet"))
    # What the package itself has to say, such as that a checkpoint cannot be written, is said.
    with pytest.raises(MlivrError, match="cannot write"), handle_interrupts():
        interrupted_then(MlivrError("cannot write"))
    with pytest.raises(RuntimeError), handle_interrupts():
        raise RuntimeError


def test_other_threads_and_ignored_signals_are_left_alone():
    def inside():
        with handle_interrupts():
            seen.append(signal.getsignal(signal.SIGINT))

    seen, before = [], signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        inside()
        signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [before, signal.SIG_IGN]
