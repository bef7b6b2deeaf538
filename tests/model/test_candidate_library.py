import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.autodiffutils import ExtractValue, InitializeAutoDiff
from pydrake.symbolic import Expression, Variable

from mirte_drake.model.candidate_library import (
    COS,
    SIN,
    CandidateLibrary,
    differentiate,
    multiply,
    parse_term,
    substitute,
    term_name,
)

VARIABLES = ("x", "theta", "u1", "u2")
factors = st.sampled_from([*VARIABLES, SIN, COS])
terms = st.lists(factors, max_size=4).map(lambda names: tuple(sorted(names)))
coefficients = st.floats(-5.0, 5.0)
polynomials = st.dictionaries(terms, coefficients, max_size=4)
values = st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4)


def evaluate(polynomial, point) -> float:
    """Evaluates term by term, without the library."""
    known = dict(zip(VARIABLES, point, strict=True))
    known |= {SIN: np.sin(known["theta"]), COS: np.cos(known["theta"])}
    return sum(c * np.prod([known[f] for f in term]) for term, c in polynomial.items())


@settings(max_examples=50)
@given(terms)
def test_name_of_a_term_is_read_back(term):
    assert parse_term(term_name(term), VARIABLES) == term


@pytest.mark.parametrize(
    ("text", "term"),
    [
        ("1", ()),
        ("1*1", ()),
        ("u1", ("u1",)),
        (" u2 * u1 ", ("u1", "u2")),
        ("u1*1*u1", ("u1", "u1")),
        ("u1*sin(theta)", (SIN, "u1")),
    ],
)
def test_terms_are_read_in_any_order(text, term):
    assert parse_term(text, VARIABLES) == term


@pytest.mark.parametrize("text", ["", "u3", "u1*", "u1**2", "u1+u2", "sin(u1)", "2*u1", "11"])
def test_unknown_factor_names_the_term(text):
    with pytest.raises(ValueError, match="unknown factor") as caught:
        parse_term(text, VARIABLES)
    assert repr(text) in str(caught.value)


def test_product_by_hand():
    p = {("u1",): 2.0, (): 1.0}
    q = {("u1",): 3.0, (): -1.0}
    assert multiply(p, q) == {("u1", "u1"): 6.0, ("u1",): 1.0, (): -1.0}


@settings(max_examples=30)
@given(polynomials, polynomials, values)
def test_product_has_the_product_of_the_values(p, q, point):
    expected = evaluate(p, point) * evaluate(q, point)
    np.testing.assert_allclose(evaluate(multiply(p, q), point), expected, rtol=1e-9, atol=1e-9)


def test_substitution_by_hand():
    p = {("a", "a", "u1"): 2.0, ("u2",): 5.0}
    a = {("x",): 3.0, (): 1.0}
    expected = {("u1", "x", "x"): 18.0, ("u1", "x"): 12.0, ("u1",): 2.0, ("u2",): 5.0}
    assert substitute(p, {"a": a}) == expected


@settings(max_examples=30)
@given(polynomials, polynomials, values)
def test_substitution_has_the_value_at_the_replaced_variable(p, replacement, point):
    p = {term: c for term, c in p.items() if not {SIN, COS} & set(term)}
    replaced = [evaluate(replacement, point), *point[1:]]
    np.testing.assert_allclose(
        evaluate(substitute(p, {"x": replacement}), point),
        evaluate(p, replaced),
        rtol=1e-9,
        atol=1e-6,
    )


@settings(max_examples=20)
@given(polynomials)
def test_substituting_a_variable_by_itself_changes_nothing(p):
    assert substitute(p, {"x": {("x",): 1.0}}) == p


@pytest.mark.parametrize(
    ("p", "variable", "derivative"),
    [
        ({("u1", "u1"): 3.0}, "u1", {("u1",): 6.0}),
        ({("u1", "u2"): 3.0, ("u1",): 1.0}, "u2", {("u1",): 3.0}),
        ({(SIN, "u1"): 2.0}, "theta", {(COS, "u1"): 2.0}),
        ({(COS, "u1"): 2.0}, "theta", {(SIN, "u1"): -2.0}),
        ({(COS, SIN): 1.0}, "theta", {(SIN, SIN): -1.0, (COS, COS): 1.0}),
        ({(SIN, "theta"): 1.0}, "theta", {(COS, "theta"): 1.0, (SIN,): 1.0}),
        ({(): 4.0, ("x",): 1.0}, "u1", {}),
    ],
)
def test_derivative_by_hand(p, variable, derivative):
    assert differentiate(p, variable) == derivative


@settings(max_examples=50)
@given(polynomials, st.sampled_from(range(4)), values)
def test_derivative_equals_central_differences(p, index, point):
    step = 1e-4 * np.eye(4)[index]
    forward, backward = evaluate(p, np.add(point, step)), evaluate(p, np.subtract(point, step))
    exact = evaluate(differentiate(p, VARIABLES[index]), point)
    np.testing.assert_allclose(exact, (forward - backward) / 2e-4, rtol=1e-4, atol=1e-4)


# The constant first: in a batch of objects it is a plain 1.
LIBRARY_TERMS = [(), ("x",), ("u1", "u2"), (SIN, "u1"), (COS, COS, "u2"), ("theta",)]


def test_library_by_hand():
    library = CandidateLibrary(VARIABLES, LIBRARY_TERMS)
    sin, cos = np.sin(0.3), np.cos(0.3)
    expected = [1.0, 2.0, -20.0, 5.0 * sin, -4.0 * cos**2, 0.3]
    np.testing.assert_allclose(library.evaluate(np.array([2.0, 0.3, 5.0, -4.0])), expected)


def test_batch_equals_single_evaluation():
    library = CandidateLibrary(VARIABLES, LIBRARY_TERMS)
    points = np.random.default_rng(0).normal(size=(2, 3, 4))
    batch = library.evaluate(points)
    assert batch.shape == (2, 3, len(LIBRARY_TERMS))
    for index in np.ndindex(2, 3):
        np.testing.assert_array_equal(batch[index], library.evaluate(points[index]))


def test_autodiff_and_symbolic_evaluation_agree_with_float():
    library = CandidateLibrary(VARIABLES, LIBRARY_TERMS)
    point = np.array([2.0, 0.3, 5.0, -4.0])
    automatic = library.evaluate(InitializeAutoDiff(point).ravel())
    symbols = [Variable(name) for name in VARIABLES]
    environment = dict(zip(symbols, point, strict=True))
    with np.errstate(invalid="ignore"):  # Of Drake's Expression in numpy's object loops.
        symbolic = library.evaluate(np.array([Expression(s) for s in symbols]))
    expected = library.evaluate(point)
    np.testing.assert_allclose(ExtractValue(automatic[1:]).ravel(), expected[1:])
    np.testing.assert_allclose([e.Evaluate(environment) for e in symbolic[1:]], expected[1:])
    np.testing.assert_allclose(automatic[2].derivatives(), [0.0, 0.0, -4.0, 5.0])


def test_library_without_terms_gives_nothing():
    library = CandidateLibrary(VARIABLES, [])
    assert library.evaluate(np.zeros((3, 4))).shape == (3, 0)


def test_library_names_factors_it_cannot_evaluate():
    with pytest.raises(ValueError, match=r"no variables: \['u9', 'vx'\]"):
        CandidateLibrary(VARIABLES, [("u9",), ("vx", "x")])
