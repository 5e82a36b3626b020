"""What a controller believes of the cable: recorded at every step, saved, reported and drawn."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from quasi_static import START, QuasiStaticPlant, straight_plan, task_for

from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.control.rod_mpc import RodMPC, RodMPCConfig
from cableway.core.errors import InputError
from cableway.core.files import read_arrays
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.figures.rollout import estimates_figure
from cableway.records import Rollout
from cableway.report import summarize
from cableway.rod.material import PARAMETERS
from cableway.rod.planar import PlanarRod
from cableway.tracking import track

PLAN = straight_plan(PlanarRod(0.3), steps=40)
TASK = task_for(PLAN)
LONGER = 0.306


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    """Of a cable that is 2% longer than nominal, held where the plan has the shorter one."""
    return track(QuasiStaticPlant(TASK, START, PlanarRod(LONGER)), RodMPC(RodMPCConfig(hold=0.5)), PLAN)


def test_every_step_has_its_estimates(rollout: Rollout) -> None:
    assert rollout.estimates is not None
    assert rollout.deviations is not None
    assert rollout.estimates.shape == rollout.deviations.shape == (rollout.steps, PARAMETERS)
    described = rollout.metadata["estimates"]
    assert [row["name"] for row in described][:2] == ["length", "stiffness mode 1"]
    assert len({row["name"] for row in described}) == PARAMETERS
    assert (rollout.deviations > 0).all()
    first, last = (row / [entry["prior"] for entry in described] for row in rollout.deviations[[0, -1]])
    assert (last < 1.0).all(), "observations reduce the uncertainty"
    assert last.mean() < 0.8 * first.mean()


def test_the_length_found_is_the_true_one(rollout: Rollout) -> None:
    length = rollout.estimated()["length"]
    assert (length.nominal, length.unit) == (0.3, "m")
    assert length.value == pytest.approx(LONGER, abs=0.001)
    assert abs(length.value - LONGER) < 2 * length.deviation
    assert length.differs


def test_what_is_known_does_not_move() -> None:
    known = RodMPCConfig(hold=0.0, estimator=EstimatorConfig.nominal())
    rollout = track(QuasiStaticPlant(TASK, START, PlanarRod(0.3)), RodMPC(known), PLAN)
    for estimate in rollout.estimated().values():
        assert (estimate.value, estimate.deviation, estimate.prior) == (estimate.nominal, 0.0, 0.0)
        assert not estimate.differs


def test_they_outlast_the_file_and_files_without_them_are_read(rollout: Rollout, tmp_path: Path) -> None:
    rollout.save(tmp_path / "with.npz")
    assert Rollout.load(tmp_path / "with.npz").estimated() == rollout.estimated()
    opened = track(QuasiStaticPlant(TASK, START, PlanarRod(0.3)), OpenLoop(OpenLoopConfig(hold=0.0)), PLAN)
    opened.save(tmp_path / "without.npz")
    assert not {"estimates", "deviations"} & set(read_arrays(tmp_path / "without.npz"))
    loaded = Rollout.load(tmp_path / "without.npz")
    assert loaded.estimates is None
    assert loaded.estimated() == {}


def test_what_does_not_belong_together_is_refused(rollout: Rollout) -> None:
    assert rollout.estimates is not None
    with pytest.raises(InputError, match="estimates and deviations go together"):
        replace(rollout, deviations=None)
    with pytest.raises(InputError, match=r"estimates has shape \(.*\), not \(K, m\)"):
        replace(rollout, estimates=rollout.estimates[1:])
    with pytest.raises(InputError, match="the metadata describe 0 estimates, there are 15"):
        replace(rollout, metadata={})
    with pytest.raises(InputError, match="estimates holds a number that is not finite"):
        replace(rollout, estimates=np.full_like(rollout.estimates, np.nan))


def test_the_report_says_what_was_found(rollout: Rollout) -> None:
    report = summarize(TASK, PLAN, rollout)
    rows = dict(report.rows())
    assert rows["estimated length"].startswith("305.")
    assert rows["estimated length"].endswith(" mm, nominal 300 mm")
    content = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert content["estimates"]["length"]["value"] == rollout.estimated()["length"].value
    same = track(QuasiStaticPlant(TASK, START, PlanarRod(0.3)), RodMPC(RodMPCConfig(hold=0.0)), PLAN)
    assert dict(summarize(TASK, PLAN, same).rows())["estimates"].startswith("none of 15 estimates")


def test_they_have_a_picture_where_one_moved(rollout: Rollout) -> None:
    assert rollout.estimates is not None
    assert estimates_figure(replace(rollout, estimates=None, deviations=None)) is None
    figure = estimates_figure(rollout)
    assert figure is not None
    curve = next(line for line in figure.axes[0].lines if str(line.get_label()).startswith("length "))
    np.testing.assert_allclose(curve.get_ydata(), (rollout.estimates[:, 0] - 0.3) / 0.006)
    assert str(curve.get_label()).startswith("length 305.8 ± 1.")
