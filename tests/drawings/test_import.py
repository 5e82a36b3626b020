"""Laws of import: what is drawn stands where it is drawn, as large as it is, and nothing else does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from drawn import BENCH, INKSCAPE, SLOT, block, circle, dxf, insert, line, svg

from cableway.cli import main
from cableway.core.errors import InputError
from cableway.drawings.arrangement import Arrangement
from cableway.drawings.convex_parts import convex_parts
from cableway.scene.files.loading import load_task
from cableway.scene.obstacles import Disc, to_shapely
from cableway.workflow.importing import ImportConfig, understood

pytest.importorskip("svgpathtools")
pytest.importorskip("ezdxf")

TOLERANCE = ImportConfig.tolerance


def scene(tmp_path: Path, name: str, text: str, **options: Any) -> Arrangement:
    (tmp_path / name).write_text(text)
    return understood(tmp_path / name, ImportConfig(**options))[1]


def bounds(found: Arrangement) -> dict[str, list[float]]:
    """Extent [mm] of each outline."""
    return {each.name: [round(1000 * side, 1) for side in each.region.bounds] for each in found.outlines}


def off(found: Arrangement) -> float:
    """Largest distance [m] between the edge of all outlines and that of all obstacles."""
    drawn = shapely.union_all([each.region for each in found.outlines])
    there = shapely.union_all([to_shapely(each) for each in found.scene.obstacles]).buffer(2e-5).buffer(-2e-5)
    return max(drawn.difference(there.buffer(TOLERANCE)).area, there.difference(drawn.buffer(TOLERANCE)).area)


def star(seed: int, spikes: int) -> shapely.Polygon:
    rng = np.random.default_rng(seed)
    turns = np.linspace(0, 2 * np.pi, 2 * spikes, endpoint=False)
    far = np.where(np.arange(2 * spikes) % 2, rng.uniform(0.02, 0.04, 2 * spikes), rng.uniform(0.05, 0.1, 2 * spikes))
    return shapely.Polygon(far[:, None] * np.column_stack([np.cos(turns), np.sin(turns)]))


COMB = shapely.union_all([shapely.box(0, 0, 0.2, 0.01), *(shapely.box(x, 0, x + 0.001, 0.1) for x in (0, 0.05, 0.199))])


@pytest.mark.parametrize("outline", [star(0, 3), star(1, 5), star(2, 12), COMB, shapely.Point(0, 0).buffer(0.1)])
def test_convex_parts_cover_an_outline_and_no_more_than_the_tolerance(outline: shapely.Polygon):
    parts = convex_parts(outline, TOLERANCE)
    assert all(part.equals(part.convex_hull) for part in parts)
    covered = shapely.union_all(parts)
    assert outline.difference(covered).area < 1e-9
    assert covered.difference(outline.buffer(TOLERANCE)).area < 1e-9


def test_what_inkscape_writes(tmp_path: Path):
    """Transforms of groups, a page in centimetres, round corners, clones, a document type, hidden layers."""
    found = scene(tmp_path, "table.svg", INKSCAPE)
    assert found.scene.size == (0.7, 0.5)
    assert bounds(found) == {
        "rect rect12": [107.4, 264.7, 192.6, 335.3],
        "path path4 'corner'": [310.0, 110.0, 430.0, 220.0],
        "circle c7": [545.0, 145.0, 595.0, 195.0],
        "ellipse e8": [150.0, 80.0, 270.0, 120.0],
    }
    discs = [each for each in found.scene.obstacles if isinstance(each, Disc)]
    assert [(*each.center, each.radius) for each in discs] == [(0.51, 0.37, 0.025), (0.57, 0.17, 0.025)]
    assert [str(each) for each in found.left_out] == [
        "path line: an open line, not an outline",
        "text t1: a text; turn it into paths if it stands there",
    ]
    assert off(found) < 1e-9


def test_lines_between_shapes(tmp_path: Path):
    """A line that is filled is closed, as SVG has it; one in a group without a fill is not."""
    body = '<path id="a" d="M0 0h50v50"/><g fill="none"><polyline id="b" points="9,9 99,9 99,99"/></g>'
    found = scene(tmp_path, "a.svg", svg(body))
    assert list(bounds(found)) == ["path a"]
    assert [each.name for each in found.left_out] == ["polyline b"]


def test_units_are_as_told_or_as_the_file_says(tmp_path: Path):
    square = '<rect x="0" y="0" width="96" height="96"/>'
    assert bounds(scene(tmp_path, "a.svg", svg(square, 'width="10in" height="10in"'))) == {
        "rect": [0, 228.6, 25.4, 254]
    }
    assert bounds(scene(tmp_path, "b.svg", svg(square), unit="cm"))["rect"] == [0, 4040, 960, 5000]
    (extent,) = bounds(scene(tmp_path, "c.dxf", dxf([circle(1, 1, 1)], unit=1))).values()
    assert extent == [150.0, 150.0, 200.8, 200.8]


def test_lines_arcs_and_blocks_of_a_dxf(tmp_path: Path):
    """Lines that meet are one outline; blocks are where they are inserted, turned and stretched."""
    post = block("POST", circle(0, 0, 10), circle(40, 0, 5))
    parts = [insert("POST", 200, 400, c50=90), insert("POST", 600, 400, c41=2), line(0, 0, 9, 9), ("TEXT", {1: "hi"})]
    found = scene(tmp_path, "a.dxf", dxf([*SLOT, *parts], blocks=post), workspace=(0, 0, 0.8, 0.6))
    extents = [[round(1000 * side) for side in each.region.bounds] for each in found.outlines]
    assert sorted(extents) == [
        [190, 390, 210, 410],
        [195, 435, 205, 445],
        [480, 100, 620, 140],
        [580, 390, 620, 410],
        [670, 395, 690, 405],
    ]
    assert [each.why for each in found.left_out] == ["open, not an outline", "TEXT, not read"]
    assert off(found) < 1e-9


def test_the_edge_of_the_table_is_named(tmp_path: Path):
    edge = [
        line(*each, layer="table") for each in ((0, 0, 900, 0), (900, 0, 900, 700), (900, 700, 0, 700), (0, 700, 0, 0))
    ]
    text = dxf([*edge, circle(100, 100, 40), circle(880, 300, 50)])
    with pytest.raises(InputError, match="name it by --frame"):
        scene(tmp_path, "a.dxf", text)
    found = scene(tmp_path, "a.dxf", text, frame="table")
    assert found.scene.size == (0.9, 0.7)
    assert [each.why for each in found.left_out] == ["cut off at the edge of the workspace"]
    assert max(each.vertices[:, 0].max() for each in found.scene.obstacles) == 0.9


def test_what_stands_on_the_table_of_a_model(tmp_path: Path):
    found = scene(tmp_path, "bench.xml", BENCH, table=0.4, workspace=(-0.4, -0.3, 0.8, 0.6))
    heights = {each.name.removeprefix("geom "): each.height for each in found.outlines}
    egg = heights.pop("egg")
    lean, turn = np.pi / 9, np.pi / 4
    axes = [0.03 * np.sin(lean) * np.cos(turn), 0.02 * np.sin(lean) * np.sin(turn), 0.02 * np.cos(lean)]
    assert egg == pytest.approx(0.01 + np.linalg.norm(axes), abs=1e-6)
    assert heights == {"block": 0.06, "post": 0.1, "pipe": 0.035, "wedge": 0.06}
    assert [str(each) for each in found.left_out] == [
        "geom lamp: hangs 900 mm above the table",
        "geom top: no higher than the table",
    ]
    assert bounds(found)["geom pipe"] == [85.0, 85.4, 315.0, 164.6]
    assert bounds(found)["geom wedge"] == [600.0, 100.0, 700.0, 200.0]
    post = next(each for each in found.scene.obstacles if isinstance(each, Disc))
    assert (post.center, post.radius, post.height) == ((0.2, 0.4), 0.02, 0.1)
    assert off(found) < 1e-9


def test_layers_of_a_height_image(tmp_path: Path):
    cv2 = pytest.importorskip("cv2")
    image = np.zeros((100, 150), np.uint16)
    image[10:40, 20:80] = 300
    image[10:20, 20:30] = 900
    image[70:90, 100:105] = image[85:90, 100:140] = 200
    image[5, 5] = 400
    cv2.imwrite(str(tmp_path / "h.png"), image)
    config = ImportConfig(pixel=0.002, step=0.0001, lowest=(0.01, 0.05))
    found = understood(tmp_path / "h.png", config)[1]
    assert found.scene.size == (0.3, 0.2)
    shown = [(each.height, [round(1000 * side) for side in each.region.bounds]) for each in found.outlines]
    assert sorted(shown) == [
        (0.02, [200, 20, 210, 60]),
        (0.02, [202, 20, 280, 30]),
        (0.03, [40, 120, 160, 180]),
        (0.09, [40, 160, 60, 180]),
    ]
    assert [str(each) for each in found.left_out] == ["1 speck: fewer than 4 pixels, from 10 mm on"]


def test_the_command_writes_a_task_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    Path("table.svg").write_text(INKSCAPE)
    assert main(["import", "table.svg", "--out", "lab.yaml", "--seed", "3"]) == 0
    said = capsys.readouterr().out
    assert "6, convex, from 5 outlines" in said
    assert "path line: an open line" in said
    task = load_task("lab.yaml")
    assert task.scene.size == (0.7, 0.5)
    assert Path("lab.png").stat().st_size > 10_000
    assert main(["import", "table.svg", "--task", "single-obstacle-2", "--out", "again", "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert (report["obstacles"], report["task"]) == (6, "again/imported.yaml")
    assert "obstacles" in report["faults"][0]
    assert main(["import", "none.svg"]) == 2
    assert "none.svg: no such file" in capsys.readouterr().err
