"""Drawings by hand and by other programs' habits, as texts."""

from __future__ import annotations

from collections.abc import Iterable

INKSCAPE = """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">
<!-- Created with Inkscape (http://www.inkscape.org/) -->
<svg width="70cm" height="500mm" viewBox="0 0 700 500" version="1.1" id="svg5"
   inkscape:version="1.2.2 (b0a8486541, 2022-12-01)" sodipodi:docname="table.svg"
   xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"
   xmlns:sodipodi="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd"
   xmlns:xlink="http://www.w3.org/1999/xlink" xmlns="http://www.w3.org/2000/svg">
  <sodipodi:namedview id="namedview7" pagecolor="#ffffff" inkscape:document-units="mm" />
  <defs id="defs2"><clipPath id="c1"><rect id="r99" width="10" height="10" x="0" y="0"/></clipPath></defs>
  <g inkscape:label="Layer 1" inkscape:groupmode="layer" id="layer1" transform="translate(10,-20)">
    <rect style="fill:#808080;stroke-width:0.5" id="rect12" width="80" height="40" x="100" y="200" ry="5"
       transform="rotate(30 140 220)"/>
    <path style="fill:#1a1a1a" d="m 300,300 h 120 v 30 h -90 v 80 h -30 z" id="path4" inkscape:label="corner"/>
    <circle id="c7" cx="500" cy="150" r="25"/>
    <ellipse id="e8" cx="200" cy="420" rx="60" ry="20"/>
    <path id="line" style="fill:none;stroke:#000" d="M 10,30 C 20,40 30,40 40,30"/>
    <text id="t1" x="20" y="60"><tspan>table</tspan></text>
    <use xlink:href="#c7" id="use3" transform="translate(60,200)"/>
  </g>
  <g style="display:none"><rect id="hidden" width="700" height="500"/></g>
</svg>
"""


def svg(body: str, head: str = 'width="700mm" height="500mm" viewBox="0 0 700 500"', before: str = "") -> str:
    return f'{before}<svg {head} xmlns="http://www.w3.org/2000/svg">{body}</svg>'


def dxf(entities: Iterable[tuple[str, dict[int, object]]], unit: int | None = 4, blocks: str = "") -> str:
    """A file of release 12 as one writes it by hand: entities with their group codes."""
    header = "" if unit is None else f"9\n$INSUNITS\n70\n{unit}\n"
    lines = [
        f"0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n{header}0\nENDSEC\n",
        f"0\nSECTION\n2\nBLOCKS\n{blocks}0\nENDSEC\n" if blocks else "",
        "0\nSECTION\n2\nENTITIES\n",
        *(entity(kind, codes) for kind, codes in entities),
        "0\nENDSEC\n0\nEOF\n",
    ]
    return "".join(lines)


def entity(kind: str, codes: dict[int, object]) -> str:
    return f"0\n{kind}\n8\n{codes.get(8, 0)}\n" + "".join(f"{c}\n{v}\n" for c, v in codes.items() if c != 8)


def block(name: str, *content: tuple[str, dict[int, object]], flags: int = 0, path: str = "") -> str:
    head = f"0\nBLOCK\n8\n0\n2\n{name}\n70\n{flags}\n10\n0.0\n20\n0.0\n3\n{name}\n1\n{path}\n"
    return head + "".join(entity(*each) for each in content) + "0\nENDBLK\n8\n0\n"


def line(x0: float, y0: float, x1: float, y1: float, layer: str = "0") -> tuple[str, dict[int, object]]:
    return "LINE", {8: layer, 10: x0, 20: y0, 11: x1, 21: y1}


def circle(x: object, y: object, radius: float, layer: str = "0") -> tuple[str, dict[int, object]]:
    return "CIRCLE", {8: layer, 10: x, 20: y, 40: radius}


def insert(name: str, x: float, y: float, **codes: object) -> tuple[str, dict[int, object]]:
    return "INSERT", {2: name, 10: x, 20: y, **{int(code[1:]): value for code, value in codes.items()}}


SLOT = [
    line(500, 100, 600, 100),
    ("ARC", {10: 600, 20: 120, 40: 20, 50: -90, 51: 90}),
    line(600, 140, 500, 140),
    ("ARC", {10: 500, 20: 120, 40: 20, 50: 90, 51: 270}),
]
"""A slot, 140 x 40, of lines and arcs that meet end to end."""

BENCH = """<mujoco model="bench">
  <compiler angle="degree" autolimits="true"/>
  <default><geom rgba=".5 .5 .5 1"/><default class="post"><geom type="cylinder" size="0.02 0.05"/></default></default>
  <asset>
    <texture name="grid" type="2d" builtin="checker" width="512" height="512"/><material name="grid" texture="grid"/>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.06  0.1 0 0.06  0 0.1 0.06"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/><geom name="floor" type="plane" size="2 2 .1" material="grid"/>
    <geom name="top" type="box" size="0.4 0.3 0.02" pos="0 0 0.38"/>
    <body name="fix" pos="0.1 0.05 0.4" euler="0 0 30"><joint type="hinge" axis="0 0 1"/>
      <geom name="block" type="box" size="0.05 0.02 0.03" pos="0 0 0.03"/></body>
    <body pos="-0.2 0.1 0.45"><geom name="post" class="post"/></body>
    <geom name="pipe" type="capsule" fromto="-0.3 -0.2 0.42  -0.1 -0.15 0.42" size="0.015"/>
    <geom name="lamp" type="sphere" pos="0 0 1.5" size="0.2"/>
    <geom name="wedge" type="mesh" mesh="wedge" pos="0.2 -0.2 0.4"/>
    <geom name="egg" type="ellipsoid" size="0.03 0.02 0.02" pos="-0.05 0.2 0.41" euler="0 20 45"/>
  </worldbody>
  <actuator><motor joint="none"/></actuator>
</mujoco>
"""
