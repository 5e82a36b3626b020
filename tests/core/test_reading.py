"""Files from anywhere: what is not a small regular file of the stated kind is refused before it costs anything."""

import io
import json
import os
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cableway.core.errors import FileFormatError
from cableway.core.reading import MOST_NUMBERS, parse_json, parse_safetensors, read_arrays, read_bytes, read_json

MANY = MOST_NUMBERS + 1


def npy(header: str, content: bytes = b"") -> bytes:
    """An .npy file of any header."""
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def archive(path: Path, members: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> None:
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, content in members.items():
            file.writestr(name, content)


def header(shape: str, dtype: str = "<f8") -> str:
    return f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}"


def sparse(path: Path) -> None:
    with path.open("xb") as file:
        file.truncate(2**33)


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        (os.mkfifo, "not a regular file of at most 256 MB"),
        (lambda path: path.symlink_to("/dev/zero"), "not a regular file of at most 256 MB"),
        (Path.mkdir, "is a folder, not a file"),
        (lambda path: path.symlink_to(path), "cannot be read: Too many levels of symbolic links"),
        (lambda path: None, "no such file"),
        (sparse, "not a regular file of at most 256 MB"),
    ],
)
@pytest.mark.parametrize("read", [read_bytes, read_arrays, lambda path: read_bytes(path, 256_000_000)])
def test_what_is_not_a_small_regular_file_is_refused_at_once(
    tmp_path: Path, place: Callable[[Path], object], sentence: str, read: Callable[[Path], object]
):
    place(tmp_path / "file")
    with pytest.raises(FileFormatError) as error:
        read(tmp_path / "file")
    assert str(error.value).replace("'", "") == f"{tmp_path / 'file'}: {sentence}"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"a": 1, "b": {"a": 2, "a": 3}}', "not JSON: the key 'a' stands twice in one object"),
        ('{"a": NaN}', "not JSON: NaN is not a finite number"),
        ("[1e400]", "not JSON: 1e400 is not a finite number"),
        ("[" * 10**5, "not JSON: nested too deeply"),
        ("[" * 70 + "]" * 70, "nested deeper than 60 levels"),
        (b"\xff{", "not JSON: 'utf-8' codec can't decode byte 0xff in position 0: invalid start byte"),
        ("", "not JSON: Expecting value: line 1 column 1 (char 0)"),
    ],
)
def test_json_is_read_strictly(text: str | bytes, sentence: str):
    with pytest.raises(FileFormatError) as error:
        parse_json(text, "file")
    assert str(error.value) == f"file: {sentence}"


def test_json_that_is_sound_is_read_as_it_is(tmp_path: Path):
    content = {"a": [1, 2.5, None, True, "ü"], "b": {"a": {}}}
    (tmp_path / "file").write_text(json.dumps(content))
    assert read_json(tmp_path / "file") == content


@pytest.mark.parametrize(
    "array",
    [np.arange(6.0).reshape(2, 3), np.asfortranarray(np.eye(3)), np.array([], str), np.array("text"), np.ones((0, 2))],
)
def test_arrays_come_back_as_they_were_and_cannot_be_written_to(tmp_path: Path, array: np.ndarray):
    np.savez_compressed(tmp_path / "file.npz", array=array)
    found = read_arrays(tmp_path / "file.npz")["array"]
    assert found.dtype == array.dtype
    np.testing.assert_array_equal(found, array)
    assert not found.flags.writeable


@pytest.mark.parametrize(
    ("members", "compression", "sentence"),
    [
        ({"a.npy": bytes(300_000_000)}, zipfile.ZIP_DEFLATED, "its arrays are larger than 256 MB"),
        ({"a.npy": npy(header("(10**12,)".replace("10**12", "1000000000000")))}, zipfile.ZIP_STORED, "array 'a' is"),
        ({"a.npy": npy(header("(1000000000000, 0)"))}, zipfile.ZIP_STORED, "array 'a' is float64[1000000000000, 0]"),
        ({"a.npy": npy(header("(2,)"), bytes(24))}, zipfile.ZIP_STORED, "array 'a' is float64[2], but has 24 bytes"),
        ({"a.npy": npy(header("(1,)", "|O"), bytes(8))}, zipfile.ZIP_STORED, "array 'a' holds Python objects"),
        ({"a.npy": npy(header("(1000000000,)", "<U0"))}, zipfile.ZIP_STORED, "array 'a' is"),
        ({"a.npy": b"", "a": b""}, zipfile.ZIP_STORED, "an archive of at most 100 arrays, each of its own name"),
        ({f"{i}.npy": b"" for i in range(200)}, zipfile.ZIP_STORED, "an archive of at most 100 arrays"),
        ({"a.npy": npy(header("()"), bytes(8))}, zipfile.ZIP_LZMA, "compressed otherwise than an .npz archive is"),
        ({"a.npy": b"text"}, zipfile.ZIP_STORED, "a damaged .npz archive"),
        ({"a.npy": npy(header(f"({MANY},)", "|i1"), bytes(MANY))}, zipfile.ZIP_DEFLATED, "array 'a' is int8["),
    ],
)
def test_an_archive_costs_no_more_memory_than_it_may(
    tmp_path: Path, members: dict[str, bytes], compression: int, sentence: str
):
    archive(tmp_path / "file.npz", members, compression)
    del members
    tracemalloc.start()
    with pytest.raises(FileFormatError) as error:
        read_arrays(tmp_path / "file.npz")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert str(error.value).startswith(f"{tmp_path / 'file.npz'}: {sentence}")
    assert most < 100_000_000


def test_safetensors_of_a_kind_that_numpy_lacks_are_refused():
    stated = json.dumps({"a": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}}).encode()
    with pytest.raises(FileFormatError, match="file: not a readable safetensors file"):
        parse_safetensors(struct.pack("<Q", len(stated)) + stated + bytes(2), "file")


def test_a_header_in_which_a_key_stands_twice_is_refused():
    stated = b'{"__metadata__": {"a": "1", "a": "2"}}'
    with pytest.raises(FileFormatError):
        parse_safetensors(io.BytesIO(struct.pack("<Q", len(stated)) + stated).getvalue(), "file")


def test_what_a_library_says_of_a_file_is_cut_short(tmp_path: Path):
    """Of an archive whose members' names do not agree, `zipfile` quotes both, however long they are."""
    path = tmp_path / "file.npz"
    archive(path, {"a.npy": npy(header("(9000,)"), bytes(72_000))}, zipfile.ZIP_STORED)
    content = bytearray(path.read_bytes())
    content[26:28] = struct.pack("<H", 60_000)  # length of the name in the member's own header
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"a damaged \.npz archive") as error:
        read_arrays(path)
    assert len(str(error.value)) < 500
