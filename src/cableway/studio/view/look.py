"""How the page looks: the colours and the letters of the figures, and what is added to viser's page for it."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Float

from cableway.figures import palette
from cableway.figures.palette import rgb as rgb
from cableway.rendering.camera import Camera

FONT = "/DejaVuSans.ttf"
"""Where the page finds the letters of the figures."""

DRAG_INTERVAL = 25
"""Time [ms] between two positions of a drag that the page sends; viser's own 50 is below 20 a second."""

COARSE = 0.75
"""Pixels drawn for one of the screen without graphics hardware; viser comes down to it by itself, within seconds."""

HEAD = f"""<title>cableway studio</title>
<style>
@font-face {{ font-family: "cableway"; src: url("{FONT}"); }}
body, body * {{ font-family: "cableway", "DejaVu Sans", Verdana, sans-serif !important; }}
canvas[data-engine] {{ background: #fafafa; }}
body {{ color: {palette.INK}; --mantine-font-size-sm: 12px; --mantine-font-size-xs: 11px; }}
.mantine-NumberInput-input {{ font-size: 11px !important; padding: 0 14px 0 4px !important; }}
</style>
<script>
document.addEventListener("DOMContentLoaded", () => {{ document.title = "cableway studio"; }});
// viser would write the address of its socket into the address bar.
history.replaceState = () => {{}};
// How often viser's page sends where a pointer is, see DRAG_INTERVAL.
const later = window.setTimeout;
window.setTimeout = (what, time, ...rest) => later(what, time === 50 ? {DRAG_INTERVAL} : time, ...rest);
// viser's page would first decode a picture of surroundings that no page of ours shows.
const fetched = window.fetch;
window.fetch = (what, ...rest) =>
  /^data:image.jpe?g/.test(what?.url ?? what) ? new Promise(() => {{}}) : fetched(what, ...rest);
// viser's page turns and moves the view by these keys, farther the slower it draws, besides what they are here for.
const moving = /^(Arrow(Up|Down|Left|Right)|Key[WASDQE])$/;
document.addEventListener("keydown", (event) => moving.test(event.code) && event.stopImmediatePropagation());
// A processor that draws in place of graphics hardware is faster without smooth edges, with fewer pixels, and without a
// copy of each picture.
const asked = HTMLCanvasElement.prototype.getContext;
const by = asked.call(document.createElement("canvas"), "webgl");
const named = by?.getParameter(by.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? by.RENDERER);
by?.getExtension("WEBGL_lose_context")?.loseContext();
if (/swiftshader|llvmpipe|software|basic render/i.test(named)) {{
  const cheap = {{ antialias: false, preserveDrawingBuffer: false }};
  HTMLCanvasElement.prototype.getContext = function (kind, options) {{
    return asked.call(this, kind, /^webgl/.test(kind) ? {{ ...options, ...cheap }} : options);
  }};
  const parameter = URLSearchParams.prototype.get;
  URLSearchParams.prototype.get = function (name) {{
    return parameter.call(this, name) ?? (name === "fixedDpr" ? String({COARSE} * devicePixelRatio) : null);
  }};
}}
</script>
"""
"""Comes before all that viser's page has in its head."""


LIGHT = (9.0, 4.7)
"""Of the light from everywhere and of that from above, so bright that the renderer's tone mapping can reach white."""

_TO_TONE = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_FROM_TONE = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
"""Of the ACES curve as three.js, which viser draws by, has it (ACESFilmicToneMapping)."""


@cache
def painted(color: str) -> tuple[int, int, int]:
    """The colour that a solid is to have so that it looks as `color` from above, under `LIGHT` and tone mapping."""
    wanted = _linear(np.array(rgb(color)) / 255)
    y = np.clip(np.linalg.solve(_FROM_TONE, wanted), 0.0, 0.99)
    # y = (v (v + a) - b) / (v (c v + d) + e)
    a, b, c, d, e = 0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081
    p, q, r = 1 - c * y, a - d * y, -b - e * y
    light = 0.6 * np.linalg.solve(_TO_TONE, (-q + np.sqrt(q * q - 4 * p * r)) / (2 * p))
    red, green, blue = _coded(np.clip(light / (sum(LIGHT) / np.pi), 0.0, 1.0))
    return round(255 * red), round(255 * green), round(255 * blue)


def _linear(coded: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)


def _coded(linear: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def lit(color: str) -> tuple[int, int, int]:
    """A colour as the vertices of a mesh have it, which the renderer takes to be linear in the light."""
    red, green, blue = 255 * _linear(np.array(rgb(color)) / 255)
    return round(red), round(green), round(blue)


def framing(
    points: Float[np.ndarray, "k 3"], direction: Float[np.ndarray, "3"], fov: float, aspect: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """From where and at what [m] a page looks that has all points in view.

    Args:
        points: [m].
        direction: In which it looks.
        fov: Angle of view down the page [rad].
        aspect: Its width over its height.
    """
    across = 2 * math.atan(math.tan(fov / 2) * aspect)
    pixels = (max(round(1000 * aspect), 1), 1000)
    camera = Camera.framing(points, direction, size=pixels, view=across, margin=0.04)
    place, ahead = camera.pose[:3, 3], camera.pose[:3, 2]
    return place, place + ((points.min(axis=0) + points.max(axis=0)) / 2 - place) @ ahead * ahead


def mixed(color: str, white: float) -> str:
    """A colour with a share of white."""
    return "#" + "".join(f"{round(value + white * (255 - value)):02x}" for value in rgb(color))


def heading(name: str, description: str) -> str:
    """Name and description of a task."""
    return (
        f'<div style="padding:2px 4px 6px"><div style="font-size:15px;font-weight:600;color:{palette.INK}">'
        f'{html.escape(name)}</div><div style="font-size:11px;color:{palette.MUTED};line-height:1.35">'
        f"{html.escape(description)}</div></div>"
    )


def sentences(texts: Sequence[str], color: str, *, numbered: bool = False) -> str:
    """Sentences one below the other, beside a bar of their colour."""
    rows = "".join(
        f'<div style="margin:2px 0">{f"<b>{number}</b> " if numbered else ""}{html.escape(text)}</div>'
        for number, text in enumerate(texts, start=1)
    )
    return (
        f'<div style="margin:2px 4px 6px;padding:4px 8px;border-left:3px solid {color};background:{mixed(color, 0.92)};'
        f'font-size:11.5px;line-height:1.4;color:{palette.INK}">{rows}</div>'
    )


def hint(text: str) -> str:
    """A sentence that says what to do."""
    return (
        f'<div style="margin:0 4px 6px;font-size:11px;line-height:1.4;color:{palette.MUTED}">{html.escape(text)}</div>'
    )


def legend(title: str, curves: Sequence[tuple[str, str]]) -> str:
    """Title of a plot, with the names of its curves in their colours."""
    names = ", ".join(
        f'<span style="color:{color};font-weight:600">{html.escape(name)}</span>' for name, color in curves
    )
    return f'<div style="margin:8px 4px 0;font-size:12px;color:{palette.INK}">{html.escape(title)}: {names}</div>'
