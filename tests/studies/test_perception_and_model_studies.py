"""The studies behind the pages of perception and models run, each on little, and print the tables of the pages."""

from __future__ import annotations

import sys
from dataclasses import replace

import marker_counts
import models
import numpy as np
import perception
import printed_page
import survey

from cableway.tang2025.models.networks import RodConfig


def test_what_stands_on_the_table_is_surveyed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(survey, "SETUPS", {"above": ("above",)})
    monkeypatch.setattr(sys, "argv", f"survey.py --first 7100 --count 1 --kinds clutter --out {tmp_path}".split())
    survey.main()
    ((head, row),) = printed_page.tables(capsys.readouterr().out)
    assert dict(zip(head, row, strict=True))["missed"] == "0"


def test_a_cable_that_is_shoved_into_a_gripper_is_not_off_at_equal_distances():
    """Its marks are 5 mm farther along its curve than the ones that are found; both curves are the same."""
    along = np.linspace(0.0, 0.3, 301)
    curve = np.column_stack([along, 0.05 * np.sin(along / 0.1)])
    poses = np.array([[*curve[5], 0.0], [*curve[-6], 0.0]])
    marks = perception.resampled(curve, 13)
    found = perception.between(curve, poses, 13)
    off = perception.off(found, marks, curve, poses)
    assert off["error"].max() > 0.004
    assert off["equal"].max() < 2e-4
    beside = perception.off(found + [0.0, 0.003], marks, curve, poses)
    assert 0.001 < beside["equal"].mean() < 0.004


def test_markers_are_left_out(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(marker_counts, "SETUPS", {"one above": (0,)})
    monkeypatch.setattr(marker_counts, "MARKED", {"none": (), "11": tuple(range(1, 12))})
    given = f"marker_counts.py --first 6301 --count 1 --every 40 --out {tmp_path}"
    monkeypatch.setattr(sys, "argv", given.split())
    marker_counts.main()
    ((head, none, eleven),) = printed_page.tables(capsys.readouterr().out)
    without, by_all = (float(row[head.index("error, mean, p99, worst [mm]")].split(",")[0]) for row in (none, eleven))
    assert by_all < without


def test_models_are_collected_for_trained_and_compared(tmp_path, monkeypatch, capsys):
    few = replace(models.TRAINING_SET, transitions=300)
    monkeypatch.setattr(models, "TRAINING_SET", few)
    monkeypatch.setattr(models, "TEST_SETS", {"nominal": replace(few, seed=101)})
    training = replace(models.TRAINING, epochs=1, batch_size=64)
    monkeypatch.setattr(models, "MODELS", {"rod": (RodConfig(damping_time=0.3), training)})
    monkeypatch.setattr(models, "ON_PLANTS", ("rod",))
    monkeypatch.setattr(models, "SHOWN", (1, 10))
    for stage in ("collect", "train", "evaluate"):
        monkeypatch.setattr(sys, "argv", ["models.py", stage, "--seeds", "1", "--out", str(tmp_path)])
        models.main()
    by_horizon, by_set = printed_page.tables(capsys.readouterr().out)
    assert [row[0] for row in by_horizon[1:]] == ["rod", "persistence", "rigid blend"]
    assert [row[0] for row in by_set[1:]] == ["nominal"]
