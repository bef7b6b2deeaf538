import multiprocessing
import pickle
import time

import numpy as np
import pytest

from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.faults import sabotage
from mirte_drake.faults.sabotage import Orders, Sabotage, Saboteur

SOLUTION = NmpcSolution(True, "", np.zeros((11, 3)), np.ones((10, 4)), 1.0, 1, 0.001)
GUESS = np.zeros(43)


class Solver:
    """Solves any problem."""

    def __init__(self):
        self.prepared = []

    def solve(self, data, guess):
        return SOLUTION

    def prepare(self, guess):
        self.prepared.append(guess)


def saboteur(act, times=sabotage.MOST):
    orders = Orders(multiprocessing.get_context("forkserver"))
    return Saboteur(Solver(), Sabotage(act, times), orders), orders


def test_a_saboteur_works_until_it_is_told_not_to():
    solver, orders = saboteur(sabotage.throw)
    assert solver.solve(None, GUESS) is SOLUTION
    solver.prepare(GUESS)
    assert solver._solver.prepared == [GUESS]
    assert orders.acted() == []
    orders.begin()
    before = time.monotonic()
    with pytest.raises(RuntimeError, match="sabotaged"):
        solver.solve(None, GUESS)
    (acted,) = orders.acted()
    assert before <= acted <= time.monotonic()


def test_it_fails_as_often_as_it_is_to():
    solver, orders = saboteur(sabotage.fail, times=2)
    orders.begin()
    solutions = [solver.solve(None, GUESS) for _ in range(4)]
    assert [solution.success for solution in solutions] == [False, False, True, True]
    assert len(orders.acted()) == 2


def test_it_takes_what_is_no_number_for_a_success():
    solver, orders = saboteur(sabotage.give_nan)
    orders.begin()
    solution = solver.solve(None, GUESS)
    assert solution.success and np.all(np.isnan(solution.inputs))


def test_it_takes_its_time():
    solver, orders = saboteur(sabotage.take(0.05))
    orders.begin()
    start = time.monotonic()
    assert solver.solve(None, GUESS) is SOLUTION
    assert time.monotonic() - start >= 0.05


@pytest.mark.parametrize("act", [sabotage.fail, sabotage.hang, sabotage.take(0.1)])
def test_it_can_be_sent_to_a_process(act):
    assert pickle.loads(pickle.dumps(Sabotage(act, 3))).times == 3


def test_the_guard_is_deaf_on_order():
    _, orders = saboteur(sabotage.fail)
    assert not orders.deaf
    orders.deafen()
    assert orders.deaf
