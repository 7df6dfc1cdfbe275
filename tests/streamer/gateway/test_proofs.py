"""Proofs of the token: what is taken, and what a listener on the network could try."""

from __future__ import annotations

import hashlib
import hmac

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.streamer.gateway.proofs import FRESH_S, Proofs, Prover, session_of

TOKEN = "correct horse battery"
KEY = "flexmotion/op3/targets/alice"


class Clock:
    """Of the run, ahead of this machine's by `ahead_s`."""

    def __init__(self) -> None:
        import time

        self._time, self.ahead_s = time.time, 0.0

    def __call__(self) -> float:
        return self._time() + self.ahead_s


def why(proofs: Proofs, proof: str, key: str = KEY, payload: bytes = b"{}", **options: bool) -> str | None:
    found = proofs.refusal(proof.encode(), key, payload, **options)
    return None if found is None else found.why


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def proofs(clock: Clock) -> Proofs:
    clock.ahead_s = -1.0  # the run began a second ago
    made = Proofs(TOKEN, clock)
    clock.ahead_s = 0.0
    return made


def test_a_proof_holds_for_its_message_and_does_not_show_the_token(proofs: Proofs) -> None:
    proof = Prover(TOKEN).prove(KEY, b"{}")
    assert TOKEN not in proof and why(proofs, proof) is None
    assert proofs.refusal(proof.encode(), KEY, b"{}").reason.endswith("taken already")  # type: ignore[union-attr]


def test_what_is_written_in_the_documents_is_what_is_checked(proofs: Proofs, clock: Clock) -> None:
    """A program in another language has nothing but the documents."""
    head = f"1 0123456789abcdef 1 {int(1e3 * clock())}"
    mac = hmac.new(TOKEN.encode(), f"{head}\n{KEY}\n".encode() + b"{}", hashlib.sha256).hexdigest()
    assert why(proofs, f"{head} {mac}") is None


def test_who_reads_along_can_do_nothing_with_it(proofs: Proofs) -> None:
    """The token itself was the attachment: every subscriber of the router could steer from then on."""
    prover = Prover(TOKEN)
    assert why(proofs, prover.prove(KEY, b"{}"), "flexmotion/op3/targets/mallory") == "token"
    assert why(proofs, prover.prove(KEY, b"{}"), payload=b'{"type":"arm"}') == "token"
    assert why(proofs, Prover("wrong horse battery").prove(KEY, b"{}")) == "token"
    assert why(proofs, TOKEN) == why(proofs, "") == why(proofs, "1 2 3") == "token"
    taken = prover.prove(KEY, b"{}")
    assert [why(proofs, taken), why(proofs, taken)] == [None, "repeated proof"]


def test_an_old_one_and_one_from_the_future_are_refused_but_for_an_emergency(proofs: Proofs, clock: Clock) -> None:
    prover = Prover(TOKEN)
    for ahead_s in (2 * FRESH_S, -2 * FRESH_S):
        clock.ahead_s = ahead_s
        assert why(proofs, prover.prove(KEY, b"{}")) == "stale proof"
        emergency = prover.prove(KEY, b"")
        assert why(proofs, emergency, payload=b"", at_any_time=True) is None
        assert why(proofs, emergency, payload=b"", at_any_time=True) == "repeated proof"


def test_a_run_that_has_just_begun_takes_nothing_that_was_sent_to_the_one_before(clock: Clock) -> None:
    """A new process does not remember what the old one took."""
    recorded = Prover(TOKEN).prove(KEY, b'{"type":"arm"}')
    clock.ahead_s = 1.0
    again = Proofs(TOKEN, clock)
    assert again.refusal(recorded.encode(), KEY, b'{"type":"arm"}').reason == "sent before this run began"  # type: ignore[union-attr]
    clock.ahead_s = 0.0  # set back: the beginning is in the future
    assert why(again, recorded, payload=b'{"type":"arm"}') is None


def test_messages_may_overtake_each_other_and_each_is_taken_once(proofs: Proofs) -> None:
    """Two threads of a program draw their numbers in one order and send in another."""
    prover = Prover(TOKEN)
    sent = [prover.prove(KEY, b"{}") for _ in range(3000)]
    order = [*range(500, 1000), *range(500), *range(1000, 3000)]
    assert {why(proofs, sent[number]) for number in order} == {None}
    assert {why(proofs, proof) for proof in sent} == {"repeated proof"}


def test_a_session_is_forgotten_only_after_thousands_of_others(proofs: Proofs) -> None:
    first = Prover(TOKEN).prove(KEY, b"{}")
    assert why(proofs, first) is None
    for _ in range(1000):
        assert why(proofs, Prover(TOKEN).prove(KEY, b"{}")) is None
    assert why(proofs, first) == "repeated proof"


def test_without_a_token_nothing_is_needed() -> None:
    assert why(Proofs(None), "") is None


@given(st.binary(max_size=300))
def test_no_bytes_are_a_proof(data: bytes) -> None:
    checks = Proofs(TOKEN)
    assert checks.refusal(data, KEY, data).why == "token"  # type: ignore[union-attr]
    assert session_of(data) is None


@given(st.data())
def test_a_proof_with_one_byte_changed_is_none(data: st.DataObject) -> None:
    proof = bytearray(Prover(TOKEN).prove(KEY, b"{}").encode())
    place = data.draw(st.integers(0, len(proof) - 1))
    proof[place] = data.draw(st.integers(0, 255).filter(lambda value: value != proof[place]))
    assert Proofs(TOKEN).refusal(bytes(proof), KEY, b"{}") is not None
