"""The page of a comparison as text."""

import json
from dataclasses import replace

from rigtwin.commands.display import show_comparison
from rigtwin.compare.compare_lab import provenance
from rigtwin.compare.report.methods import methods
from rigtwin.compare.report.page import drawn_figures, report
from rigtwin.compare.result_files import document


def drawn(whole, out, *rows):
    """The page with these deviations of the first experiment alone."""
    first, *_ = whole.outcomes
    whole = replace(whole, outcomes=(replace(first, deviations=rows),))
    record = json.loads(document(provenance(whole)))
    return report(whole, record, out, drawn_figures(whole), methods(whole, record["versions"]))


def test_an_interval_that_goes_on_beyond_its_drawing_ends_in_an_arrow(comparison, tmp_path):
    whole = comparison()
    row = whole.outcomes[0].deviations[0]
    near = replace(
        row,
        measured=1.0,
        measured_std_uncertainty=0.0,
        simulated=1.04,
        simulated_std_uncertainty=0.001,
        percent_deviation=4.0,
        coverage_factor=1.96,
    )
    assert 'class="beyond' not in drawn(whole, tmp_path, near)
    assert 'class="beyond' in drawn(whole, tmp_path, replace(near, simulated_std_uncertainty=0.4))


def test_z_stands_beside_the_limit_that_it_is_held_against(comparison, tmp_path, capsys):
    whole = comparison()
    row = replace(whole.outcomes[0].deviations[0], z=7.6, coverage_factor=12.706)
    assert "+7.6 (±12.7)" in drawn(whole, tmp_path, row)
    assert "+7.6 (±2.0)" in drawn(whole, tmp_path, replace(row, coverage_factor=1.96))
    first, *_ = whole.outcomes
    show_comparison(replace(whole, outcomes=(replace(first, deviations=(row,)),)))
    assert "+7.6 (±12.7)" in capsys.readouterr().out
