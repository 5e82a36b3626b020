"""The studies behind the pages of perception and models run, each on little, and print the tables of the pages."""

from __future__ import annotations

import sys
from dataclasses import replace

import models
import printed_page
import survey

from cableway.tang2025.models.networks import RodConfig


def test_what_stands_on_the_table_is_surveyed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(survey, "SETUPS", {"above": ("above",)})
    monkeypatch.setattr(sys, "argv", f"survey.py --first 7100 --count 1 --kinds clutter --out {tmp_path}".split())
    survey.main()
    ((head, row),) = printed_page.tables(capsys.readouterr().out)
    assert dict(zip(head, row, strict=True))["missed"] == "0"


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
