"""Subscripts and powers are set in pages and in figures."""

from html import unescape

import pytest
from matplotlib.figure import Figure
from pages import as_plain_text_has_it

from experiments.lab.charts import save
from experiments.lab.page import typeset
from experiments.lab.symbols import mathtext

TEXTS = ("V_p + 2 T (m/s)", "k_c up to 1e5 N/m^1.5", "F_T at v_in", "rises with k_c^(2/5)", "10^-3 < d")


@pytest.mark.parametrize("text", TEXTS)
def test_a_page_shows_neither_underscore_nor_caret_and_says_the_same(text):
    page = typeset(text)
    assert "_" not in page
    assert "^" not in page
    assert unescape(as_plain_text_has_it(page)).replace("(2/5)", "2/5") == text.replace("(2/5)", "2/5")


@pytest.mark.parametrize("text", TEXTS)
def test_a_figure_has_them_between_dollars(text):
    outside = "".join(mathtext(text).split("$")[::2])
    assert "_" not in outside
    assert "^" not in outside


@pytest.mark.parametrize("text", ["$10^5$", "impact_gym", "RK45, solve_ivp", "M$_X^{-1}$"])
def test_what_is_set_already_and_names_of_programs_stay(text):
    assert mathtext(text) == text


def test_a_saved_figure_has_its_symbols_set_wherever_they_stand(tmp_path):
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], label="error of V_p")
    axes.set(title="k_c", xlabel="V_p (m/s)", ylabel="v_in")
    axes.annotate("x_r", (0.5, 0.5))
    axes.legend()
    drawn = save(figure, tmp_path / "figure.svg").read_text()
    for symbol in ("V_p", "k_c", "v_in", "x_r"):
        assert symbol not in drawn
