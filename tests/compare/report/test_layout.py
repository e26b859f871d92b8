"""The report in a browser: nothing sticks out of its card, on paper nothing is cut, rows sort and filter."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from rigtwin.benchmarks.review.opened_page import CHROMIUM
from rigtwin.compare.compare_lab import provenance
from rigtwin.compare.report.methods import methods
from rigtwin.compare.report.page import drawn_figures, report
from rigtwin.compare.result_files import document

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium here: apt-get install chromium")

WIDTHS = (1000, 1200, 1600)  # [px]
STICKS_OUT = """() => {
  const found = [];
  const wide = document.documentElement;
  if (wide.scrollWidth > wide.clientWidth) found.push(`the page is ${wide.scrollWidth} px wide`);
  for (const card of document.querySelectorAll("section, header")) {
    const edge = card.getBoundingClientRect();
    for (const one of card.querySelectorAll("*")) {
      const box = one.getBoundingClientRect();
      if (one.closest("svg") !== null && one.tagName !== "svg") continue;
      if (box.width > 0 && (box.right > edge.right + 1 || box.left < edge.left - 1)) {
        found.push(`${one.tagName} ${one.className} from ${box.left} to ${box.right} in a card to ${edge.right}`);
      }
    }
  }
  return found;
}"""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def address(comparison, tmp_path_factory) -> str:
    """The page of a comparison with long names, many digits and rows with notes."""
    whole = comparison(title="A title of many words that goes on and on, as titles of laboratory notebooks do")
    fall, heap = whole.outcomes
    long = replace(fall.experiment, id="drop-of-a-bead-of-ash-wood-on-a-polished-plate-of-stainless-steel-no-2")
    rows = [
        replace(row, experiment=long.id, simulated_std_uncertainty=1.234e-4, note="one repetition measured " * 9)
        for row in fall.deviations
    ]
    rows += [replace(rows[0], quantity="rebound_height", unit="m", verdict="too few repetitions to tell")]
    doubtful = replace(heap.deviations[0], verdict="doubtful", doubtful="the heap leans on the rim of its base")
    named = replace(fall, experiment=long, deviations=tuple(rows))
    whole = replace(whole, outcomes=(named, replace(heap, deviations=(*heap.deviations, doubtful))))
    page = tmp_path_factory.mktemp("out") / "report.html"
    record = json.loads(document(provenance(whole)))
    text = methods(whole, record["versions"])
    page.write_text(report(whole, record, page.parent, drawn_figures(whole), text), encoding="utf-8")
    return page.as_uri()


@pytest.fixture(scope="module")
def tab(browser, address):
    page = browser.new_page(viewport={"width": 1200, "height": 800})
    page.faults = []
    page.on("pageerror", lambda fault: page.faults.append(str(fault)))
    page.on("request", lambda request: page.faults.append(request.url) if request.url != address else None)
    return page


@pytest.fixture
def page(tab, address):
    """The page as it opens."""
    tab.set_viewport_size({"width": 1200, "height": 800})
    tab.emulate_media(media="screen", color_scheme="light")
    tab.goto(address)
    yield tab
    assert tab.faults == [], "a script failed, or something was fetched"


def test_nothing_sticks_out_of_its_card_at_any_width(page):
    page.evaluate("() => document.querySelectorAll('details').forEach(one => { one.open = true; })")
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate(STICKS_OUT) == [], width
        verdict = page.locator("table.results td:last-child .verdict").first.bounding_box()
        assert verdict["x"] + verdict["width"] < width - 40


def test_the_page_follows_the_dark_mode_and_plots_keep_their_white_ground(page):
    shade = "one => getComputedStyle(one).backgroundColor"
    grounds = []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        grounds.append((page.locator("section").first.evaluate(shade), page.locator(".plot svg").first.evaluate(shade)))
    (light, plot), (dark, same) = grounds
    assert light != dark
    assert plot == same == "rgb(255, 255, 255)"


def test_on_paper_nothing_is_cut_and_rows_stay_whole(page):
    page.set_viewport_size({"width": 703, "height": 800})  # A4 less the margins of the page, at 96 px an inch
    page.emulate_media(media="print")
    assert page.evaluate(STICKS_OUT) == []
    for one in ("table.results tr", "figure", ".settings"):
        assert page.locator(one).first.evaluate("one => getComputedStyle(one).breakInside") == "avoid"
    assert page.locator(".filter select").first.is_hidden()
    assert page.locator("details").first.is_hidden(), "what is closed is not printed"


def test_rows_are_filtered_by_rig_and_verdict(page):
    rigs, verdicts = page.locator(".filter select").all()
    rows = page.locator("table.results").first.locator("tbody tr")
    assert rows.count() == 2
    rigs.select_option("Pile")
    assert [row.is_visible() for row in rows.all()] == [False, True]
    assert "1 of 2 rows" in page.locator(".filter").inner_text()
    rigs.select_option("")
    assert [row.is_visible() for row in rows.all()] == [True, True]
    shown = rows.first.get_attribute("data-verdict")
    verdicts.select_option(shown)
    assert [row.get_attribute("data-verdict") for row in rows.all() if row.is_visible()] == [shown]


def test_a_click_on_a_column_sorts_by_its_numbers(page):
    table = page.locator("table.results").first
    head = table.locator("th", has_text="Deviation")

    def column():
        return [float(text.replace("−", "-").split()[0]) for text in table.locator("td.strong").all_inner_texts()]

    written = column()
    head.locator("button").click()
    assert column() == sorted(written)
    assert head.get_attribute("aria-sort") == "ascending"
    head.locator("button").click()
    assert column() == sorted(written, reverse=True)
    head.locator("button").click()
    assert column() == written


def test_links_to_figures_lead_into_the_folder_of_the_page(page, address):
    links = page.locator("figcaption .files a").evaluate_all("all => all.map(one => one.href)")
    here = address.removesuffix("report.html")
    assert [Path(link).suffix for link in links[:3]] == [".svg", ".png", ".csv"]
    assert all(link.startswith(f"{here}figures/") for link in links)


def test_without_scripts_all_rows_are_there_and_no_control(browser, address):
    page = browser.new_page(java_script_enabled=False)
    page.goto(address)
    assert page.locator("table.results tbody tr").first.is_visible()
    assert page.locator(".filter").is_hidden()
    assert page.locator("th button").count() == 0
