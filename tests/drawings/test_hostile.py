"""Laws of import: what cannot be understood is refused in one sentence, and nothing is fetched."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from drawn import block, circle, dxf, insert, svg

from cableway.core.errors import InputError
from cableway.workflow.importing import ImportConfig, understood

pytest.importorskip("svgpathtools")
pytest.importorskip("ezdxf")

RECT = '<rect id="a" x="10" y="10" width="50" height="50"/>'
BOMB = "".join(f'<g id="g{k + 1}">' + f'<use href="#g{k}"/>' * 10 + "</g>" for k in range(9))
BLOCKS = block("B0", circle(0, 0, 1)) + "".join(
    block(f"B{k + 1}", *(insert(f"B{k}", 10 * j, 0) for j in range(10))) for k in range(9)
)
GEOM = '<geom type="box" size=".1 .1 .1"/>'

FILES = {
    "entities.svg": (svg("&b;", before='<!DOCTYPE s [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]>'), "entities are not read"),
    "outside.svg": (svg("&b;", before='<!DOCTYPE s [<!ENTITY b SYSTEM "file:///etc/passwd">]>'), "entities are not"),
    "deep.svg": (svg("<g>" * 200 + "</g>" * 200), "nested deeper than 100 levels"),
    "half.svg": (svg(RECT)[:-3], "not XML"),
    "other.svg": ("<html/>", "not SVG"),
    "many.svg": (svg('<circle r="3"/>' * 1001), "more than 1000 outlines"),
    "billion.svg": (svg(f'<g id="g0"/>{BOMB}'), "more than 1500 elements"),
    "loop.svg": (svg('<g id="a"><use href="#a"/></g>'), "is a clone of #a, which is not there or itself"),
    "fetch.svg": (svg('<use href="https://example.org/a.svg#b"/>'), "nothing is fetched"),
    "nan.svg": (svg('<path id="p" d="M 0 nan L 1 1"/>'), "path p: not a shape: path data"),
    "inf.svg": (svg('<path id="p" d="M 0 0 L 1e999 1 L 3 3 z"/>'), "path p: not a shape: a curve has a number"),
    "number.svg": (svg('<rect width="nan" height="3"/>'), "'nan' is no number"),
    "far.svg": (svg('<circle r="1e30"/>'), "farther than 1000 m"),
    "spun.svg": (svg(f'<g transform="rotate(1e308, 1e308, 1)">{RECT}</g>'), "not finite"),
    "far.xml": ('<mujoco><worldbody><geom size="1e308" pos="1e300 0 0"/></worldbody></mujoco>', "far.xml: "),
    "mended.dxf": (dxf([circle("9#0", 0, 9)]), "mended.dxf: not a DXF file that can be read"),
    "turned.svg": (svg('<g transform="matrix(1 2)"/>'), "g: "),
    "unit.svg": (svg(RECT, 'viewBox="0 0 700 500"'), "give --unit, one of m, dm, cm, mm"),
    "pixels.svg": (svg(RECT, 'width="700px" height="500px"'), "does not say how long its unit is"),
    "empty.svg": (svg(""), "no outline in the workspace"),
    "hole.svg": (svg('<path id="p" d="M10 10h50v50h-50z M20 20v10h10v-10z"/>'), "has no holes"),
    "nested.svg": (svg(f'<rect id="edge" width="700" height="500"/>{RECT}'), "rect a, at (35, 465) mm, lies in"),
    "crossed.svg": (svg('<polygon id="p" points="0,0 50,50 50,0 0,50"/>'), "polygon p crosses or touches itself"),
    "nothing.dxf": ("", "not a DXF file"),
    "bytes.dxf": ("\0\1\2" * 99, "not a DXF file"),
    "billion.dxf": (dxf([insert("B9", 0, 0)], blocks=BLOCKS.replace("CIRCLE", "POINT")), "more than 1500 entities"),
    "many.dxf": (dxf([insert("B0", 0, 0, c70=9999, c71=9999, c44=3, c45=3)], blocks=BLOCKS), "99980001 times"),
    "outside.dxf": (dxf([insert("X", 0, 0)], blocks=block("X", flags=4, path="/etc/passwd")), "in another file"),
    "unit.dxf": (dxf([circle(0, 0, 9)], unit=None), "it does not say what its unit is"),
    "far.dxf": (dxf([circle(0, 1e30, 9)]), "farther than 1000 m"),
    "nan.dxf": (dxf([circle(float("nan"), 0, 9)]), "nan.dxf: "),
    "hole.dxf": (dxf([circle(90, 90, 9), circle(90, 90, 50)]), "has no holes"),
    "include.xml": ('<mujoco><include file="/etc/passwd"/></mujoco>', "<include>, which is not read"),
    "mesh.xml": ('<mujoco><asset><mesh name="m" file="a.stl"/></asset></mujoco>', "the mesh 'm' is in another file"),
    "plugin.xml": ('<mujoco><extension><plugin plugin="x"/></extension></mujoco>', "<extension>, which is not read"),
    "many.xml": (f'<mujoco><worldbody><replicate count="999">{GEOM}</replicate></worldbody></mujoco>', "<replicate>"),
    "nan.xml": ('<mujoco><worldbody><geom size=".1" pos="nan 0 0"/></worldbody></mujoco>', "MuJoCo model"),
    "broken.xml": ('<mujoco><worldbody><geom size="-1"/></worldbody></mujoco>', "not a MuJoCo model"),
    "urdf.xml": ("<robot/>", "its root is <robot>"),
    "none.xml": ("<mujoco/>", "no closed outline"),
    "no.png": ("", "a height image needs --pixel and --step and --lowest"),
    "a.step": ("", "it must end in one of .svg, .dxf, .xml"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_what_cannot_be_understood_is_refused(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cableway.drawings.svg.MOST_SHAPES", 1500)
    monkeypatch.setattr("cableway.drawings.dxf.MOST_ENTITIES", 1500)
    text, said = FILES[name]
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    with pytest.raises(InputError) as error:
        understood(tmp_path / name, ImportConfig())
    assert [each.name for each in tmp_path.iterdir()] == [name]
    assert said in str(error.value)
    assert name in str(error.value)


@pytest.mark.parametrize("name", ["a.svg", "a.dxf", "a.xml"])
def test_large_files_are_not_read(tmp_path: Path, name: str):
    with open(tmp_path / name, "wb") as file:
        file.truncate(11_000_000)
    with pytest.raises(InputError, match="not a regular file of at most 10 MB"):
        understood(tmp_path / name, ImportConfig())


def png(width: int, height: int) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBBI", 13, b"IHDR", width, height, 16, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"GIF89a", "not a PNG picture"), (png(60000, 60000), "too many"), (png(3, 3), "not a grey PNG picture")],
)
def test_pictures_that_are_no_height_images(tmp_path: Path, content: bytes, said: str):
    pytest.importorskip("cv2")
    (tmp_path / "h.png").write_bytes(content)
    with pytest.raises(InputError, match=said):
        understood(tmp_path / "h.png", ImportConfig(pixel=0.001, step=0.001, lowest=(0.01,)))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"unit": "px"}, "--unit must be one of m, dm"),
        ({"tolerance": float("nan")}, "--tolerance must be from 1e-05"),
        ({"pixel": -1.0}, "--pixel must be above 0"),
        ({"lowest": (0.2, 0.1)}, "--lowest must be ascending"),
        ({"table": 0.4}, "--table is for a model"),
        ({"workspace": (0, 0, float("inf"), 1)}, "--workspace must be"),
        ({"workspace": (0, 0, 0, 0)}, "workspace"),
        ({"frame": "none"}, "--frame none: 0 outlines are called so; there are: rect a"),
    ],
)
def test_options_out_of_range(tmp_path: Path, options: dict, said: str):
    (tmp_path / "a.svg").write_text(svg(RECT))
    with pytest.raises(InputError) as error:
        understood(tmp_path / "a.svg", ImportConfig(**options))
    assert said in str(error.value)
