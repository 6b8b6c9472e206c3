"""How a statement of the paper is judged: to which digits, what 'about' allows, and by two readings."""

import pytest

from experiments.paper.statements import Basis, Section, Verdict, agreeing_digits


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
def test_agreeing_digits(printed, ours, digits):
    assert agreeing_digits(printed, ours) == digits


@pytest.mark.parametrize(
    ("ours", "text", "verdict"),
    [
        (0.9786, "is 0.98", Verdict.DIGITS),
        (0.9786, "is about 0.98", Verdict.DIGITS),
        (0.972, "is 0.98", Verdict.DISAGREES),
        (0.972, "is about 0.98", Verdict.AGREES),
        (0.968, "is about 0.98", Verdict.DISAGREES),
    ],
)
def test_number_allows_one_unit_of_the_last_digit_after_about(ours, text, verdict):
    statement = Section("1").identified.number(f"the velocity {text}", "0.98 m/s", ours)
    assert (statement.verdict, statement.basis, statement.unit) == (verdict, Basis.IDENTIFIED, "m/s")


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("second", [True, False])
def test_read_as_agrees_only_if_both_readings_do(first, second):
    read = Section("1").claim("the text", first, "so", "a rule").read_as("meant otherwise", second, "thus")
    alone = Verdict.AGREES if first else Verdict.DISAGREES
    assert read.verdict == (alone if first == second else Verdict.ONE_READING)
    assert read.otherwise == f"Another reading, meant otherwise: thus ({'agrees' if second else 'disagrees'})."
