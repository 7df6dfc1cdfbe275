"""One operator at a time."""

from __future__ import annotations

from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.lease import Lease

SETTINGS = Gateway(priorities={"rescue": 10, "script": -5}, lease_s=10.0)
FREE = "it is free 10 s after the operator's last message"


def test_the_first_who_sends_holds_the_lease_and_another_is_refused_by_name() -> None:
    lease = Lease(SETTINGS)
    assert lease.refusal("page", 0.0) is None and lease.holder == "page"
    way = f"it can be taken over by 'take'; {FREE}"
    assert lease.refusal("phone", 1.0) == f"'page' is the operator; {way}"
    assert lease.holder == "page"


def test_an_equal_takes_over_by_asking_for_it() -> None:
    lease = Lease(SETTINGS)
    lease.refusal("page", 0.0)
    assert lease.refusal("phone", 1.0, take=True) is None
    assert (lease.holder, lease.takeovers) == ("phone", 1)


def test_priority_decides_and_belongs_to_the_settings() -> None:
    lease = Lease(SETTINGS)
    lease.refusal("page", 0.0)
    assert lease.refusal("script", 1.0, take=True) == f"'page' is the operator; its priority is higher; {FREE}"
    assert lease.refusal("rescue", 2.0) is None and lease.holder == "rescue"
    assert lease.refusal("page", 3.0, take=True) == f"'rescue' is the operator; its priority is higher; {FREE}"


def test_each_page_has_the_priority_of_pages() -> None:
    """Pages have names of their own, so that two of them are two operators."""
    lease = Lease(Gateway(priorities={"page": -1, "page b": 5}, lease_s=10.0))
    assert lease.refusal("joystick", 0.0) is None
    assert lease.refusal("page a", 1.0, take=True) == f"'joystick' is the operator; its priority is higher; {FREE}"
    assert lease.refusal("page b", 1.0) is None


def test_the_lease_lapses_when_its_holder_is_silent_and_can_be_given_back() -> None:
    lease = Lease(SETTINGS)
    lease.refusal("page", 0.0)
    lease.refusal("page", 8.0)
    assert lease.refusal("phone", 17.0) is not None
    assert lease.refusal("phone", 18.5) is None and lease.takeovers == 0
    assert not lease.release("page") and lease.holder == "phone"
    assert lease.release("phone") and lease.holder is None
