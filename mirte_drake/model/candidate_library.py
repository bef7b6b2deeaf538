"""The candidate terms theta(x, u) of a sparse model: products of variables, sin and cos of yaw.

A term is a sorted tuple of factor names: ``("sin(theta)", "u1")``; the empty tuple is 1. A
polynomial maps terms to coefficients. Both are closed under multiplication and differentiation,
so a model's Jacobians are further tables of the same terms and no equation is typed by hand.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

HEADING = "theta"
SIN, COS = f"sin({HEADING})", f"cos({HEADING})"

Term = tuple[str, ...]
Polynomial = dict[Term, float]


def parse_term(text: str, variables: Iterable[str]) -> Term:
    """Returns the term written as a product, for example ``sin(theta)*u1`` or ``u1*u1``.

    Raises:
        ValueError: when a factor is no variable, ``sin(theta)``, ``cos(theta)`` or ``1``.
    """
    known = {*variables, SIN, COS}
    factors = [factor.strip() for factor in text.split("*")]
    factors = [factor for factor in factors if factor != "1"]
    for factor in factors:
        if factor not in known:
            raise ValueError(f"term {text!r}: unknown factor {factor!r}; known: {sorted(known)}")
    return tuple(sorted(factors))


def term_name(term: Term) -> str:
    """Returns the term as text that ``parse_term`` reads back."""
    return "*".join(term) or "1"


def multiply(p: Mapping[Term, float], q: Mapping[Term, float]) -> Polynomial:
    """Returns the product of two polynomials."""
    product: Polynomial = {}
    for p_term, p_coefficient in p.items():
        for q_term, q_coefficient in q.items():
            term = tuple(sorted(p_term + q_term))
            product[term] = product.get(term, 0.0) + p_coefficient * q_coefficient
    return product


def substitute(p: Mapping[Term, float], replacements: Mapping[str, Polynomial]) -> Polynomial:
    """Returns p with each named factor replaced by a polynomial."""
    result: Polynomial = {}
    for term, coefficient in p.items():
        expanded: Polynomial = {(): coefficient}
        for factor in term:
            expanded = multiply(expanded, replacements.get(factor, {(factor,): 1.0}))
        for new_term, value in expanded.items():
            result[new_term] = result.get(new_term, 0.0) + value
    return result


def differentiate(p: Mapping[Term, float], variable: str) -> Polynomial:
    """Returns the partial derivative of a polynomial by one variable (product rule)."""
    inner: dict[str, Polynomial] = {variable: {(): 1.0}}
    if variable == HEADING:
        inner |= {SIN: {(COS,): 1.0}, COS: {(SIN,): -1.0}}
    result: Polynomial = {}
    for term, coefficient in p.items():
        for position, factor in enumerate(term):
            others = term[:position] + term[position + 1 :]
            for new_term, value in multiply({others: coefficient}, inner.get(factor, {})).items():
                result[new_term] = result.get(new_term, 0.0) + value
    return {term: value for term, value in result.items() if value != 0.0}


class CandidateLibrary:
    """Evaluates a fixed list of terms, over any leading batch axes and any scalar type."""

    def __init__(self, variables: Sequence[str], terms: Sequence[Term]) -> None:
        """Prepares the evaluation.

        Args:
            variables: Names of the entries of the evaluated vector; one of them is ``theta``.
            terms: The terms, in the order of the result.

        Raises:
            ValueError: when a term has a factor that is not evaluated here.
        """
        self.terms = tuple(terms)
        names = ["1", *variables, SIN, COS]
        unknown = sorted({f for term in terms for f in term if f not in names})
        if unknown:
            raise ValueError(f"terms have factors that are no variables: {unknown}")
        length = max((len(term) for term in terms), default=1) or 1
        padded = [[*term, *["1"] * (length - len(term))] for term in terms]
        indices = [[names.index(f) for f in row] for row in padded]
        self._factors = np.array(indices, dtype=int).reshape(len(terms), length)
        self._heading = list(variables).index(HEADING)

    def evaluate(self, values: np.ndarray) -> np.ndarray:
        """Returns the terms.

        Args:
            values: (..., v) the variables; float, AutoDiffXd or Expression.

        Returns:
            (..., number of terms).
        """
        heading = values[..., self._heading : self._heading + 1]
        one = np.ones_like(heading)
        factors = np.concatenate([one, values, np.sin(heading), np.cos(heading)], axis=-1)
        result = factors[..., self._factors[:, 0]]
        for column in self._factors.T[1:]:
            result = result * factors[..., column]
        return result
