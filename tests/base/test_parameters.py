"""Bounds of parameters, and covariances of estimated parameters."""

import numpy as np
import pytest

from omnimirror.base.errors import InvalidParameter
from omnimirror.base.parameters import Parameter, Uncertainty

LENGTH = Parameter("mm", 1.0, 5.0)
WORD = Parameter("", 0.0, 0.0, "attachment", ("rim", ""))


@pytest.mark.parametrize("value", [1.0, 2.5, 5.0, 1, 5, np.float64(5.0), (1, 5.0), [], ()])
def test_bounds_are_inclusive(value):
    """The number of values of a list is checked by the part, not here."""
    LENGTH.check("length_mm", value)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (0.5, "length_mm must be between 1 and 5 mm; got 0.5"),
        (5.5, "length_mm must be between 1 and 5 mm; got 5.5"),
        (-3.0, "length_mm must be between 1 and 5 mm; got -3"),
        (6, "length_mm must be between 1 and 5 mm; got 6"),
        ((2.0, 3.0, 0.5), r"length_mm\[2\] must be between 1 and 5 mm; got 0.5"),
        ([6.0], r"length_mm\[0\] must be between 1 and 5 mm; got 6"),
        ("2", "length_mm"),
        (float("nan"), "length_mm"),
    ],
)
def test_values_out_of_bounds_are_rejected(value, message):
    with pytest.raises(InvalidParameter, match=f"^{message}"):
        LENGTH.check("length_mm", value)


def test_message_without_unit():
    with pytest.raises(InvalidParameter, match=r"^index must be between 1 and 5; got 7$"):
        Parameter("", 1.0, 5.0).check("index", 7.0)


def test_text_is_checked_against_the_choices_only():
    for word in ("rim", ""):
        WORD.check("attachment", word)
    for invalid in ("vertex", 0.0, ["rim"]):
        with pytest.raises(InvalidParameter, match=r"^attachment must be one of rim, ''; got "):
            WORD.check("attachment", invalid)


NAMES = ("a", "b", "c")


def constant(correlation, count):
    """Return a matrix of ones with one correlation of all pairs; its lowest eigenvalue is 1 - correlation."""
    matrix = np.full((count, count), correlation)
    np.fill_diagonal(matrix, 1.0)
    return matrix.tolist()


@pytest.mark.parametrize(
    "covariance",
    [
        [[0.0]],
        [[4.0]],
        [[4.0, 0.0], [0.0, 0.0]],
        # eigenvalues of about -c^2 and 1; at most 1e-9 of the largest is due to rounding
        [[0.0, 2e-5], [2e-5, 1.0]],
        constant(1 + 1e-12, 2),
        [[1.0, 0.5], [0.5 + 9e-10, 1.0]],
        constant(1 + 2e-9, 3),  # 3, and twice -2e-9
    ],
)
def test_covariance_may_be_singular_except_for_rounding(covariance):
    count = len(covariance)
    uncertainty = Uncertainty(NAMES[:count], covariance)
    assert uncertainty.covariance == tuple(map(tuple, covariance))
    assert uncertainty.field_deg is None
    assert list(uncertainty.sigmas.values()) == pytest.approx(
        np.sqrt(np.diag(covariance)), rel=1e-12
    )


@pytest.mark.parametrize(
    ("names", "covariance", "message"),
    [
        ((), (), r"names must be different names of parameters; got \(\)"),
        (("a", "a"), constant(0.0, 2), "names must be different names of parameters"),
        (("a", "b"), [[1.0, 0.0]], r"covariance must have the shape \(2, 2\) for 2 names"),
        (("a", "b"), [*constant(0.0, 2), [0.0, 0.0]], r"covariance must have the shape \(2, 2\)"),
        (("a", "b"), [[1.0, 0.0], [0.0]], r"covariance must have the shape \(2, 2\)"),
        (("a", "b"), [[1.0, 0.0], [0.0, 1.0, 0.0]], r"covariance must have the shape \(2, 2\)"),
        (("a", "b"), [[1.0, 2e-9], [0.0, 1.0]], "covariance must be symmetric"),
        (("a", "b"), [[1.0, 0.1], [0.2, 1.0]], "covariance must be symmetric"),
        (("a", "b"), constant(1.1, 2), "covariance must have no negative eigenvalues"),
        (("a", "b"), constant(-1.1, 2), "covariance must have no negative eigenvalues"),
        (("a", "b", "c"), constant(1 + 4e-9, 3), "no negative eigenvalues"),
        (("a", "b"), [[0.0, 5e-5], [5e-5, 1.0]], "no negative eigenvalues"),
        (("a",), [[-1.0]], "no negative eigenvalues"),
        (("a",), [[np.inf]], "covariance"),
    ],
)
def test_invalid_covariance_is_rejected(names, covariance, message):
    with pytest.raises(InvalidParameter, match=message):
        Uncertainty(names, covariance)


@pytest.mark.parametrize(("field_deg", "is_valid"), [(0.0, False), (0.5, True), (180.0, True)])
def test_calibrated_field_is_above_0_and_at_most_180_deg(field_deg, is_valid):
    if is_valid:
        assert Uncertainty(("a",), [[1.0]], field_deg).field_deg == field_deg
    for invalid in (-0.5, 180.5) if is_valid else (field_deg,):
        with pytest.raises(InvalidParameter, match=r"field_deg must be .*180 deg"):
            Uncertainty(("a",), [[1.0]], invalid)


def test_marginal_sigmas_replace_the_diagonal():
    uncertainty = Uncertainty(("a", "b"), constant(0.5, 2), marginal_sigmas=np.array([0.0, 3.0]))
    assert uncertainty.sigmas == {"a": 0.0, "b": 3.0}
    assert uncertainty.marginal_sigmas == (0.0, 3.0)
    for invalid in ((1.0,), (1.0, 2.0, 3.0), ((1.0, 2.0),), 1.0):
        with pytest.raises(
            InvalidParameter,
            match=r"marginal_sigmas must have the shape \(2,\) of names; got shape",
        ):
            Uncertainty(("a", "b"), constant(0.5, 2), marginal_sigmas=invalid)
    for invalid in ((1.0, -0.5), (1.0, np.nan)):
        with pytest.raises(InvalidParameter, match="marginal_sigmas"):
            Uncertainty(("a", "b"), constant(0.5, 2), marginal_sigmas=invalid)


def test_covariance_of_more_parameters_is_zero_for_exact_ones():
    uncertainty = Uncertainty(("b", "a"), [[4.0, 0.5], [0.5, 9.0]]).of(("a", "x", "b"))
    assert uncertainty.tolist() == [[9.0, 0.0, 0.5], [0.0, 0.0, 0.0], [0.5, 0.0, 4.0]]
    with pytest.raises(
        InvalidParameter, match="parameters of the uncertainty must be from a, x; got b"
    ):
        Uncertainty(("b", "a"), constant(0.0, 2)).of(("a", "x"))
