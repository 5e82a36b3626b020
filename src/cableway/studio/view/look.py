"""How the page looks: the colours and the letters of the figures, and what is added to viser's page for it."""

from __future__ import annotations

import html
from collections.abc import Sequence

from cableway.figures import style

FONT = "/DejaVuSans.ttf"
"""Where the page finds the letters of the figures."""

DRAG_INTERVAL = 25
"""Time [ms] between two positions of a drag that the page sends; viser's own 50 is below 20 a second."""

HEAD = f"""<title>cableway studio</title>
<style>
@font-face {{ font-family: "cableway"; src: url("{FONT}"); }}
body, body * {{ font-family: "cableway", "DejaVu Sans", Verdana, sans-serif !important; }}
body {{ color: {style.INK}; --mantine-font-size-sm: 12px; --mantine-font-size-xs: 11px; }}
</style>
<script>
document.addEventListener("DOMContentLoaded", () => {{ document.title = "cableway studio"; }});
// viser would write the address of its socket into the address bar.
history.replaceState = () => {{}};
// How often viser's page sends where a pointer is, see DRAG_INTERVAL.
const later = window.setTimeout;
window.setTimeout = (what, time, ...rest) => later(what, time === 50 ? {DRAG_INTERVAL} : time, ...rest);
</script>
"""
"""Comes before all that viser's page has in its head."""


def rgb(color: str) -> tuple[int, int, int]:
    """A colour such as "#0072b2" as viser takes it."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def mixed(color: str, white: float) -> str:
    """A colour with a share of white."""
    return "#" + "".join(f"{round(value + white * (255 - value)):02x}" for value in rgb(color))


def heading(name: str, description: str) -> str:
    """Name and description of a task."""
    return (
        f'<div style="padding:2px 4px 6px"><div style="font-size:15px;font-weight:600;color:{style.INK}">'
        f'{html.escape(name)}</div><div style="font-size:11px;color:{style.MUTED};line-height:1.35">'
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
        f'font-size:11.5px;line-height:1.4;color:{style.INK}">{rows}</div>'
    )


def hint(text: str) -> str:
    """A sentence that says what to do."""
    return f'<div style="margin:0 4px 6px;font-size:11px;line-height:1.4;color:{style.MUTED}">{html.escape(text)}</div>'
