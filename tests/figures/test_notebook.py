"""Laws of what records show in a notebook."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from pathlib import Path

import pytest
from recorded import moved_aside, moved_plan, perfect_rollout

import cableway as cw
from cableway.core.errors import InputError
from cableway.figures.notebook import Animation, html
from cableway.workflow.run import Run

TASK, PLAN = moved_plan(rows=9)
ROLLOUT = perfect_rollout(TASK, PLAN)


def pictures(shown: str) -> list[bytes]:
    return [base64.b64decode(found) for found in re.findall("data:image/png;base64,([A-Za-z0-9+/=]+)'", shown)]


def cells(shown: str) -> dict[str, str]:
    return dict(re.findall(r"<th[^>]*>(.*?)</th><td[^>]*>(.*?)</td>", shown))


@pytest.mark.parametrize(("record", "row"), [(TASK, "workspace"), (PLAN, "plan"), (ROLLOUT, "rollout")])
def test_records_show_a_picture_and_a_table(record, row: str):
    shown = record._repr_html_()
    (picture,) = pictures(shown)
    assert picture.startswith(b"\x89PNG")
    assert row in cells(shown)


def test_a_picture_is_of_the_record():
    """Another motion is another picture, and the same one the same."""
    other = moved_aside(ROLLOUT, 0.05)
    assert html(ROLLOUT) == html(ROLLOUT)
    assert pictures(html(ROLLOUT)) != pictures(html(other))
    assert cells(html(other))["largest deviation"] == "50.0 mm"


def test_a_report_shows_its_rows_and_a_run_a_picture_as_well():
    report = cw.summarize(TASK, PLAN, ROLLOUT)
    assert cells(report._repr_html_()) == dict(report.rows())
    run = Run(task=TASK, report=report, plan=PLAN, rollout=ROLLOUT)
    assert cells(run._repr_html_()) == dict(report.rows())
    assert len(pictures(run._repr_html_())) == 1


def test_what_a_user_wrote_is_no_html():
    report = replace(cw.summarize(TASK, PLAN, ROLLOUT), notes=("<script>alert(1)</script>\x1b[0m",))
    assert "<script" not in report._repr_html_()
    assert "\x1b" not in report._repr_html_()
    with pytest.raises(InputError, match="a Task, a Plan or a Rollout, got 3"):
        html(3)


def test_a_rollout_is_animated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cableway.figures.notebook.write_video", lambda path, *_, **__: path.write_bytes(b"film"))
    film = ROLLOUT.animate(TASK)
    assert isinstance(film, Animation)
    assert f"data:video/mp4;base64,{base64.b64encode(b'film').decode()}" in film._repr_html_()
    film.save(tmp_path / "run.mp4")
    assert (tmp_path / "run.mp4").read_bytes() == b"film"
    with pytest.raises(InputError, match="a video is written to a file that ends"):
        film.save(tmp_path / "run.gif")
