"""The first signal is remembered, the second one acts."""

from __future__ import annotations

import os
import signal

import pytest

from flexmotion.streamer.commands.first_signal import first_signal


@pytest.mark.usefixtures("hears_interrupt")
def test_the_second_signal_does_what_it_did_before(capfd: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), first_signal() as signalled:
        assert not signalled()
        os.kill(os.getpid(), signal.SIGINT)
        assert signalled() and "signal again to end at once" in capfd.readouterr().err
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.usefixtures("hears_hangup")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_that_end_a_program_are_remembered_too(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with first_signal() as signalled:
        os.kill(os.getpid(), number)
        assert signalled()
    assert signal.getsignal(number) is before


def test_a_signal_that_is_ignored_stays_so() -> None:
    """Under nohup a training goes on when its terminal is closed."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with first_signal() as signalled:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not signalled()
    finally:
        signal.signal(signal.SIGHUP, before)
