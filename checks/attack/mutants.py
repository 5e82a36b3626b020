"""Plain data and files, spoilt at random."""

from __future__ import annotations

import copy
import io
import json
import math
import os
import random
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

NUMBERS = [
    0, -1, 1, 2, 13, 0.3, -0.0, 1e-320, 1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e12, 1e308, 10**400, 2**31, 2**63, 1 << 64,
    math.nan, math.inf, -math.inf,
]  # fmt: skip
TEXTS = [
    "", " ", "x", "0.3", "1e3", "~", "true", "nan", "$x", r"\frac{1}{0}", r"$\mathbf{", "a$b$c^{", r"\\",
    "%s{0}{}", "é", "Å", "🪢", "\u202eevil", "\x1b[31mred", "\x1b]0;title\x07", "\x00", "\r", "a\nb",
    "\u2028", "\ud7ff", "../../x", "/", "/etc/passwd", ".", "-", "--help", "x" * 300, "x" * 100_000,
    "[bold]x[/bold]", "<script>", "con|cat", "'\"`;",
]  # fmt: skip
OTHERS: list[Any] = [None, True, False, [], {}, [[]], {"": 0}, [0, 0], [[0, 0]] * 3, {"type": "box"}, [1e400]]


def value(rng: random.Random) -> Any:
    """Anything that may stand somewhere."""
    kind = rng.random()
    if kind < 0.45:
        return rng.choice(NUMBERS)
    if kind < 0.7:
        return rng.choice(TEXTS)
    if kind < 0.95:
        return copy.deepcopy(rng.choice(OTHERS))
    return nested(rng.choice([5, 70, 200]))


def nested(depth: int) -> Any:
    """Lists in lists."""
    found: Any = 0
    for _ in range(depth):
        found = [found]
    return found


def places(content: Any) -> list[tuple[Any, ...]]:
    """Every place below the top of nested mappings and lists."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [place for key, inner in items for place in [(key,), *((key, *below) for below in places(inner))]]


def mutated(content: Any, rng: random.Random) -> tuple[Any, str]:
    """Plain data with one to three places spoilt, and what was done."""
    content, done = copy.deepcopy(content), []
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        place = rng.choice(places(content) or [()])
        if not place:
            break
        *outer, key = place
        inner = content
        for step in outer:
            inner = inner[step]
        done.append(f"{'.'.join(map(str, place))} {_spoilt(inner, key, rng)}")
    return content, ", ".join(done)


def _spoilt(inner: Any, key: Any, rng: random.Random) -> str:
    """Change one entry; in words."""
    kind, old = rng.random(), inner[key]
    if kind < 0.12:
        del inner[key]
        return "removed"
    if kind < 0.2 and isinstance(inner, dict):
        inner[rng.choice(["box", "type", "size", "x" * 40, "cableway", "\x1b[1m", "unknown"])] = inner.pop(key)
        return "renamed"
    if kind < 0.3 and isinstance(inner, list):
        inner.insert(key, copy.deepcopy(old))
        return "doubled"
    if kind < 0.65 and isinstance(old, (int, float)) and not isinstance(old, bool):
        factor = rng.choice([-1, 0, 0.5, 0.9, 1.001, 1.1, 2, 10, 57.3, 1e3, 1e-3, 1e-9, 1e9, 1e300])
        inner[key] = type(old)(old * factor) if factor < 1e8 else float(old * factor)
        return f"times {factor:g}"
    inner[key] = value(rng)
    return f"= {brief(inner[key])}"


def brief(content: Any) -> str:
    """What stands in the name of a case."""
    return repr(content)[:30]


def as_yaml(content: Any, rng: random.Random) -> bytes:
    """YAML text; now and then spoilt as text."""
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=rng.choice([None, True, False]))
    return torn(text, rng) if rng.random() < 0.15 else text.encode("utf-8", "surrogatepass")


def as_json(content: Any, rng: random.Random) -> bytes:
    """The same as JSON, which has other numbers than finite ones, too."""
    text = json.dumps(content)
    return torn(text, rng) if rng.random() < 0.15 else text.encode("utf-8", "surrogatepass")


def torn(text: str, rng: random.Random) -> bytes:
    """A piece of the text replaced by another."""
    start = rng.randrange(len(text) + 1)
    piece = rng.choice([
        "[", "{", "}", "]", ":", "\t", "!!int ", "!!binary ", "!!python/object:os.system ", "&a ", "*a", "<<: ",
        "---\n", "\x00", "\xa0", "[" * 5000, "{a: " * 5000, "'", '"', "\n", "0x", "1_000", "- ", "? ",
        "|", ">", "%", "@", "`",
    ])  # fmt: skip
    return (text[:start] + piece + text[start + rng.randrange(20) :]).encode("utf-8", "surrogatepass")


def damaged(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    """Bytes cut, turned over, or other ones."""
    kind, size = rng.choice(["cut", "turned", "turned", "zeros", "other", "longer"]), len(content)
    at = rng.randrange(max(1, size))
    if kind == "cut":
        return content[:at], f"cut at {at}"
    if kind == "turned":
        spoilt = bytearray(content)
        for _ in range(rng.choice([1, 1, 8, 100])):
            spoilt[rng.randrange(rng.choice([size, min(size, 400)]))] ^= 1 << rng.randrange(8)
        return bytes(spoilt), "bits turned"
    if kind == "zeros":
        return content[:at] + bytes(min(200, size - at)) + content[at + 200 :], f"zeros at {at}"
    if kind == "longer":
        return content + rng.randbytes(rng.choice([1, 1000])), "bytes appended"
    return rng.randbytes(rng.choice([0, 1, 10, 5000])), "random bytes"


# ---------------------------------------------------------------------------------------------- no files at all
def fifo(path: Path) -> None:
    os.mkfifo(path)


def folder(path: Path) -> None:
    path.mkdir()


def loop(path: Path) -> None:
    path.symlink_to(path.name)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def empty(path: Path) -> None:
    path.touch()


def missing(path: Path) -> None:
    path.unlink(missing_ok=True)


def endless(path: Path) -> None:
    """Of 400 GB, all of them holes."""
    with open(path, "wb") as file:
        file.truncate(400_000_000_000)


def unreadable(path: Path) -> None:
    path.symlink_to("/proc/self/mem")


def bomb(path: Path) -> None:
    """An archive of 4 GB in 4 MB."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        header = io.BytesIO()
        shape = {"descr": "<f8", "fortran_order": False, "shape": (125_000_000, 2, 2)}
        np.lib.format.write_array_header_1_0(header, shape)
        with archive.open("shapes.npy", "w", force_zip64=True) as member:
            member.write(header.getvalue())
            for _ in range(400):
                member.write(bytes(1_000_000))
        archive.writestr("centreline.npy", header.getvalue())


def laughs(path: Path) -> None:
    """A billion entries of YAML, by names of names."""
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 10)]
    path.write_text("\n".join(rows))


NO_FILES: list[Callable[[Path], None]] = [
    fifo, folder, loop, device, empty, missing, endless, unreadable, bomb, laughs,
]  # fmt: skip
