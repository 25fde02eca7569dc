"""Work that runs beside the device keeps its order and its limits; its errors are raised in the caller."""

from __future__ import annotations

import threading
import time
from contextvars import ContextVar

import pytest

from pyibr.app.commands.beside import Behind, read_ahead

CHOSEN: ContextVar[str] = ContextVar("chosen", default="none")


def test_things_are_read_ahead_in_their_order_and_context():
    made = list[int]()

    def things():
        for number in range(9):
            made.append(number)
            yield number, CHOSEN.get(), threading.current_thread()

    token = CHOSEN.set("here")
    found = list[int]()
    for number, chosen, thread in read_ahead(things()):
        assert len(made) <= number + 3 and chosen == "here" and thread is not threading.main_thread()
        found.append(number)
    CHOSEN.reset(token)
    assert found == made == list(range(9))


def test_errors_of_what_is_read_come_after_what_was():
    def things():
        yield 1
        raise ValueError("torn")

    ahead = read_ahead(things())
    assert next(ahead) == 1
    with pytest.raises(ValueError, match="torn"):
        next(ahead)


@pytest.mark.parametrize("in_order", [True, False])
def test_all_calls_are_done_at_the_end(in_order):
    done = list[int]()

    def call(number: int) -> None:
        time.sleep(0.002 * (5 - number))
        done.append(number)

    with Behind(in_order) as behind:
        for number in range(5):
            behind.add(lambda number=number: call(number))
    assert (done if in_order else sorted(done)) == list(range(5))


def test_an_error_of_a_call_is_raised_at_the_end():
    with pytest.raises(ValueError, match="full"), Behind(True) as behind:
        behind.add(lambda: (_ for _ in ()).throw(ValueError("full")))
