"""What a diagnosis leaves behind, whatever its numbers are."""

import json
from types import SimpleNamespace

import numpy as np

from clearance.diagnose import _write
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.declaration import read_declaration


def outcome(**more):
    fit = SimpleNamespace(values=np.array([[np.nan, 700.0]]))
    nominal = SimpleNamespace(label="nominal", misfit=np.inf, fit=fit)
    diagnosis = {"verdict": "unknown", "summary": ["It is lost."], "warnings": [], **more}
    explanation = SimpleNamespace(nominal=nominal, attempts=[])
    return SimpleNamespace(diagnosis=diagnosis, evidence={}, machine=SliderCrank(), explanation=explanation)


def test_a_number_that_nobody_knows_is_null_and_costs_no_other(tmp_path):
    (tmp_path / "sensors.yaml").write_text("sensors: {}")  # of an earlier run
    _write(tmp_path, outcome(fit={"held_out": {"before": 3.0, "after": np.nan, "high": np.inf}}))
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["fit"]["held_out"] == {"before": 3.0, "after": None, "high": None}
    assert (tmp_path / "report.html").stat().st_size > 0
    assert not (tmp_path / "sensors.yaml").exists()


def test_what_sensors_do_may_lie_beside_another_recording(tmp_path):
    one = {"value": 1.01, "low": 1.0, "high": 1.02, "unit": ""}
    turned = {"value": -1.5, "low": -2.0, "high": -1.0, "unit": "deg"}
    sensors = {
        "rod_b_axial": {"gain": one, "mounting_angle": turned},
        "rod_b_transverse": {"gain": one},
        "slider_horizontal": {"gain": one, "mounting_angle": turned},  # its other axis was not recorded
        "crank_angle": {"delay": {"value": 1e-5, "low": 0.0, "high": 2e-5, "unit": "s"}},
    }
    _write(tmp_path, outcome(sensors=sensors))
    (tmp_path / "sensors.yaml").rename(tmp_path / "run.yaml")
    declared = read_declaration(tmp_path / "run.parquet").sensors
    assert declared["rod_b_axial"] == {"gain": 1.01, "mounting_angle": -1.5}
    assert declared["slider_horizontal"] == {"gain": 1.01}
    assert declared["crank_angle"] == {"delay": 1e-5}
