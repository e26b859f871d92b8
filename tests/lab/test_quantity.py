"""What a measurement says, as JSON."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.errors import BadInput, rename_options
from rigtwin.lab.quantity import Check, Evaluation, Measurement, Quantity, doubted, reworded, root_sum_of_squares

# numbers below 1e-308 are zero wherever a library has set the processor to flush them
FLOATS = st.floats(allow_subnormal=False)


def strict_json(document):
    return json.loads(json.dumps(document, allow_nan=False))


@settings(deadline=None, derandomize=True)
@given(value=FLOATS, std=FLOATS, part=FLOATS, bounce=st.integers(1, 9))
def test_any_quantity_is_valid_json_and_not_a_number_becomes_null(value, std, part, bounce):
    quantity = Quantity(
        "restitution_wall", value, std, "1", "height", detail={"bounce": bounce}, budget={"scale": part}
    )
    read = strict_json(quantity.to_json())
    assert read["bounce"] == bounce
    for key, number in (("value", value), ("std_uncertainty", std)):
        assert read[key] == (number if np.isfinite(number) else None)


def test_numbers_of_numpy_are_printed_as_plain_numbers():
    quantity = Quantity("drop_height", np.float64(0.3), np.float32(0.25), "m", "apex", detail={"frame": np.int64(7)})
    read = strict_json(quantity.to_json())
    assert (read["value"], read["std_uncertainty"], read["frame"]) == (0.3, 0.25, 7)


def test_what_is_empty_is_not_printed():
    plain = Quantity("drop_height", 0.3, 0.001, "m", "apex").to_json()
    assert set(plain) == {"quantity", "value", "std_uncertainty", "unit", "method"}
    doubtful = Quantity("drop_height", 0.3, 0.001, "m", "apex", n=3, doubtful="the clip ends too early").to_json()
    assert doubtful["doubtful"] == "the clip ends too early"
    assert doubtful["n"] == 3


def test_the_interval_of_95_percent_holds_95_percent_of_a_normal_sample():
    sample = np.random.default_rng(1).normal(2.0, 0.3, 40_000)
    low, high = Quantity("restitution_wall", 2.0, 0.3, "1", "height").interval95
    inside = np.mean((sample > low) & (sample < high))
    assert inside == pytest.approx(0.95, abs=0.005)  # binomial standard deviation 0.001


@settings(deadline=None, derandomize=True)
@given(st.dictionaries(st.text(), st.floats(0, 1e6, allow_subnormal=False), min_size=1))
def test_parts_never_add_up_to_less_than_the_largest_or_more_than_their_sum(budget):
    total = root_sum_of_squares(budget)
    assert max(budget.values()) <= total * (1 + 1e-9)
    assert total <= sum(budget.values()) * (1 + 1e-9)


def test_a_measurement_prints_the_document_of_the_command():
    measurement = Measurement(
        rig="drop",
        source=Path("clip.mp4"),
        source_sha256="ab" * 32,
        quantities=(Quantity("restitution_wall", 0.443, 0.006, "1", "height", detail={"bounce": 1}),),
        checks=(Check("gravity", np.True_, 9.79, 9.81, "close"),),
        warnings=("short clip",),
        camera={"frame_rate_hz": np.float64(240), "scale_m_per_px": float("nan"), "scale_from": "bead"},
        files={"plot": Path("out/plot.svg")},
    )
    read = strict_json(measurement.to_json())
    assert read["source"] == {"file": "clip.mp4", "sha256": "ab" * 32}
    assert read["camera"] == {"frame_rate_hz": 240.0, "scale_m_per_px": None, "scale_from": "bead"}
    assert read["checks"][0]["passed"] is True
    assert read["quantities"][0]["bounce"] == 1
    assert read["files"] == {"plot": "out/plot.svg"}


def test_reasons_for_doubt_stand_in_a_row_without_full_stops():
    found = doubted(Quantity("restitution_wall", 0.44, 0.01, "1", "height"), "a clip of 240 Hz.; the rim shows 6.5 mm.")
    assert found.doubtful == "a clip of 240 Hz; the rim shows 6.5 mm"


@dataclass(frozen=True)
class Run:
    """A result of which texts stand at several depths."""

    evaluation: Evaluation
    assumptions: dict[str, str]
    reason: str = ""
    heights: tuple[float, ...] = (0.1, 0.2)


def test_a_result_is_reworded_wherever_its_texts_stand_and_is_not_copied_elsewhere():
    doubtful = Quantity("bed_height", 0.1, 0.01, "m", "outline", detail={"view": "bed--base"}, doubtful="check --base")
    run = Run(Evaluation((doubtful,)), {"--": "as --floor says", "wall": "smooth"}, "with --only")
    new, files = reworded(
        (run, {"report": Path("--base.html")}), lambda text: rename_options(text, lambda name, _: name)
    )
    assert new.assumptions == {"--": "as floor says", "wall": "smooth"}
    assert new.reason == "with only"
    assert new.evaluation.quantities[0].doubtful == "check base"
    assert new.evaluation.quantities[0].detail == {"view": "bed--base"}
    assert files == {"report": Path("--base.html")}
    assert new.heights is run.heights
    assert reworded(new, lambda text: text) is new


def test_without_a_scale_a_missing_length_is_refused_with_that_reason():
    angle = Quantity("angle_of_repose_graphical", 25.0, 0.3, "deg", "line", detail={"side": "left"})
    other = Quantity("angle_of_repose_graphical", 26.0, 0.3, "deg", "arc", detail={"side": "right"})
    heap = Measurement("pile", Path("pile.jpg"), "", (angle, other), camera={"scale_m_per_px": None})
    with pytest.raises(BadInput, match="which have no lengths as no scale is known; there are angle_of_repose"):
        heap.value("pile_height")
    with pytest.raises(BadInput, match="graphical: none has method='arc' and side='left'; there are angle_of_repose"):
        heap.value("angle_of_repose_graphical", "arc", side="left")
