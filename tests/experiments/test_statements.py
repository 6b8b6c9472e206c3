"""How a statement of the paper is judged: to which digits, what 'about' allows, and by two readings."""

import pytest

from experiments.paper import statements
from experiments.paper.statements import Verdict


@pytest.mark.parametrize(
    ("printed", "ours", "digits"),
    [
        ("0.98", 0.9786, (2, 2)),
        ("0.95", 0.9786, (1, 2)),
        ("1.88", 1.8602, (2, 3)),
        ("5e1", 51.04, (1, 1)),
        ("90", 89.0, (1, 2)),
        ("2", 1.99987, (1, 1)),
        ("0.321", 0.4, (0, 3)),
        ("1.0", 1.049, (2, 2)),
    ],
)
def test_digits_to_which_a_printed_number_is_agreed_with(printed, ours, digits):
    assert statements.agreeing_digits(printed, ours) == digits


@pytest.mark.parametrize(
    ("ours", "about", "verdict"),
    [
        (0.9786, False, Verdict.DIGITS),
        (0.9786, True, Verdict.DIGITS),
        (0.972, False, Verdict.DISAGREES),
        (0.972, True, Verdict.AGREES),
        (0.968, True, Verdict.DISAGREES),
    ],
)
def test_about_allows_one_unit_of_the_last_digit_and_no_more(ours, about, verdict):
    text = "the velocity is about 0.98" if about else "the velocity is 0.98"
    assert statements.Section("1").number(text, "0.98", ours).verdict == verdict


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("second", [True, False])
def test_two_readings_are_one_statement_that_agrees_only_if_both_do(first, second):
    read = statements.Section("1").claim("the text", first, "so", "a rule").read_as("meant otherwise", second, "thus")
    alone = Verdict.AGREES if first else Verdict.DISAGREES
    assert read.verdict == (alone if first == second else Verdict.ONE_READING)
    assert read.otherwise == f"Another reading, meant otherwise: thus ({'agrees' if second else 'disagrees'})."
