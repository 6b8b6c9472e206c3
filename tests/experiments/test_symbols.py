"""Subscripts and powers are set in pages and in figures."""

from html import unescape

import pytest
from matplotlib.figure import Figure
from pages import as_plain_text_has_it

from experiments.lab.charts import save
from experiments.lab.page import typeset
from experiments.lab.symbols import mathtext


@pytest.mark.parametrize(
    "text", ["V_p + 2 T (m/s)", "k_c up to 1e5 N/m^1.5", "F_T at v_in", "rises with k_c^(2/5)", "10^-3 < d"]
)
def test_typeset_and_mathtext_leave_neither_underscore_nor_caret(text):
    page, outside = typeset(text), "".join(mathtext(text).split("$")[::2])
    assert not {"_", "^"} & {*page, *outside}
    assert unescape(as_plain_text_has_it(page)).replace("(2/5)", "2/5") == text.replace("(2/5)", "2/5")


@pytest.mark.parametrize("text", ["$10^5$", "impact_gym", "RK45, solve_ivp", "M$_X^{-1}$"])
def test_mathtext_leaves_names_of_programs_and_what_is_set_already(text):
    assert mathtext(text) == text


def test_save_sets_symbols_wherever_they_stand(tmp_path):
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], label="error of V_p")
    axes.set(title="k_c", xlabel="V_p (m/s)", ylabel="v_in")
    axes.annotate("x_r", (0.5, 0.5))
    axes.legend()
    drawn = save(figure, tmp_path / "figure.svg").read_text()
    assert not [symbol for symbol in ("V_p", "k_c", "v_in", "x_r") if symbol in drawn]
