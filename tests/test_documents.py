"""What the documents name exists: modules, classes, fields, files, links and commands."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import re
from functools import cache
from pathlib import Path
from typing import Any

import accuracy.pictures
import pictures
import pytest
from spatial_problems import ball_task

import cableway
from cableway.cli.collect import Collect
from cableway.cli.entry import DONE, FAILED, INTERRUPTED, WRONG_INPUT
from cableway.datasets.recordings import Description
from cableway.outcome import Outcome
from cableway.scene.files.described_arms import load_described_arms
from cableway.scene.files.document import read_document
from cableway.scene.files.loading import load_cell
from cableway.scene.files.schema import GrippersSection, TaskFile, WorkspaceSection, validate
from cableway.scene.grippers import Plug, Port
from cableway.simulation.episodes import CollectionConfig
from cableway.simulation.perturbations.reading import read_perturbation
from cableway.simulation.perturbations.spatial_reading import read_spatial_perturbation
from cableway.simulation.spatial_plant import SpatialConfig
from cableway.simulation.table_plant import TableConfig

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
CODE = re.compile(r"`([^`\n]+)`")
WITHIN = r"(planning|scene|tracking|report|verification)\.(?!py$|json$|html$)\w+(\.\w+)*$"
YAML = re.compile(r"^```yaml\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s#]+)[^)]*\)|src=\"([^\"]+)\"")


def pairs(pattern: str) -> list[tuple[str, str]]:
    """(document, code span) for each code span that matches `pattern` from its beginning."""
    found = {
        (document.name, span) for document in DOCUMENTS for span in CODE.findall(document.read_text())
        if re.match(pattern, span)
    }  # fmt: skip
    return sorted(found)


@cache
def classes() -> dict[str, Any]:
    modules = [importlib.import_module(found.name) for found in pkgutil.walk_packages(cableway.__path__, "cableway.")
               if not found.name.endswith("__main__")]  # fmt: skip
    return {name: value for module in modules for name, value in inspect.getmembers(module, inspect.isclass)
            if value.__module__.startswith("cableway")}  # fmt: skip


def resolve(dotted: str) -> Any:
    """The object that a dotted name stands for."""
    parts = dotted.split(".")
    for split in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:split]))
        except ModuleNotFoundError:
            continue
        for part in parts[split:]:
            value = getattr(value, part)
        return value
    raise AttributeError(dotted)


def test_there_is_something_to_check():
    assert len(DOCUMENTS) >= 6
    assert len(pairs(r"cableway\.")) > 10


@pytest.mark.parametrize(("document", "span"), pairs(r"cableway\.(?!methods$)\w+(\.\w+)*$"))
def test_dotted_names_exist(document: str, span: str):
    """All but `cableway.methods`, the group of entry points."""
    resolve(span)


@pytest.mark.parametrize(("document", "span"), pairs(WITHIN))
def test_names_within_the_package_exist(document: str, span: str):
    resolve(f"cableway.{span}")


@pytest.mark.parametrize(("document", "span"), pairs(r"(?!Makefile|[A-Z_\d]+\.)[A-Z]\w+\.\w+"))
def test_fields_and_methods_exist(document: str, span: str):
    name, member = re.match(r"(\w+)\.(\w+)", span).groups()  # pyright: ignore[reportOptionalMemberAccess]
    owner = classes()[name]
    known = {field.name for field in dataclasses.fields(owner)} if dataclasses.is_dataclass(owner) else set()
    assert member in known or hasattr(owner, member)


@pytest.mark.parametrize(("document", "span"), pairs(r"[A-Z]\w+\(.*\)$"))
def test_configurations_can_be_made(document: str, span: str):
    eval(span, dict(classes()))


@pytest.mark.parametrize(("document", "span"), pairs(r"[\w./-]+/[\w.-]*$|\w+\.(py|toml|lock|md|cff)$"))
def test_files_exist(document: str, span: str):
    made = {"demo/", "site/", "out/", "runs/", "runs/simulator/", "runs/bench", "tables.md", "reproduction.md"}
    assert span in made or any((folder / span).exists() for folder in (ROOT, ROOT / "src" / "cableway", ROOT / "docs"))


def whole_files() -> list[str]:
    blocks = [block for document in DOCUMENTS for block in YAML.findall(document.read_text())]
    return [block for block in blocks if "cableway: 1" in block]


def test_every_file_shown_can_be_read(tmp_path: Path):
    """A task, which has a start, a collection, a recording, a cell, arms, or a plant, in space or not."""
    path, tasks, plants, collections, recordings, cells, arms, spatial = tmp_path / "shown.yaml", 0, 0, 0, 0, 0, 0, 0
    for block in whole_files():
        path.write_text(block)
        if "\nstart:" in block:
            tasks += bool(cableway.load_task(path).description)
        elif "collection:" in block:
            collections += Collect(config=path).configuration() != CollectionConfig()
        elif "\nfile:" in block:
            recordings += Path(validate(read_document(path), Description)["file"]).suffix == ".csv"
        elif "frame: grasp" in block:
            arms += len(load_described_arms(path).arms) == 2
        elif "\narms:" in block:
            cells += len(load_cell(path).arms) == 2
        elif "\nspatial:" in block:
            shown = read_spatial_perturbation(path, ball_task())
            assert (shown.cable is None, shown.config) == (False, SpatialConfig()), "all keys, with their defaults"
            spatial += 1
        else:
            plants += read_perturbation(path, cableway.load_task("multi-obstacle-1")).cable != cableway.Cable()
    assert tasks + plants + collections + recordings + cells + arms + spatial == len(whole_files())
    assert min(tasks, plants, collections, recordings, cells, arms, spatial) > 0


def blocks(page: str, first: str) -> list[str]:
    """Blocks of YAML on a page that begin with a key and are no whole files."""
    found = YAML.findall((ROOT / "docs" / page).read_text())
    return [block for block in found if block.startswith(first)]


def test_the_keys_of_a_task_are_shown_with_their_defaults(tmp_path: Path):
    """But for `cableway`, `start` and `goal`, which have none, and `name` and `description`."""
    (shown,) = blocks("tasks.md", "units: m ")
    given = "cableway: 1\nstart: {grippers: [[0.1, 0.1, 0.5], [0.35, 0.1, -0.5]], bend: left}\n"
    given += given.splitlines()[1].replace("start", "goal") + "\n"
    path = tmp_path / "task.yaml"
    path.write_text(given)
    expected = cableway.load_task(path)
    path.write_text(given + shown)
    assert cableway.load_task(path) == expected
    keys = set(re.findall(r"\b(\w+)\b", shown))
    sections = (TaskFile, WorkspaceSection, cableway.Cable, GrippersSection, Plug, Port)
    fields = {field.name for section in sections for field in dataclasses.fields(section)}
    assert fields - keys == {"cableway", "start", "goal", "name", "description"}


def test_the_keys_of_a_plant_are_shown_with_their_defaults(tmp_path: Path):
    (general,), (table,), (faults,) = (blocks("plants.md", first) for first in ("cable: {}", "table:", "faults:"))
    path, task = tmp_path / "plant.yaml", cableway.load_task("multi-obstacle-1")
    path.write_text("cableway: 1\n" + general.replace("obstacles: []", "obstacles: [[0, 0], [0, 0], [0, 0], [0, 0]]"))
    shown, default = read_perturbation(path, task), cableway.Perturbation()
    for key in ("grasp", "sensing", "simulation", "pegs", "revealed", "faults", "table", "arms"):
        assert getattr(shown, key) == getattr(default, key)
    path.write_text(f"cableway: 1\n{table}{faults}")
    assert read_perturbation(path, task).table == TableConfig()
    assert read_perturbation(path, task).faults == default.faults
    keys = set(re.findall(r"\b(\w+)\b", general + table + faults))
    configs = (default, default.grasp, default.sensing, default.faults, default.simulation, TableConfig())
    fields = {field.name for config in configs for field in dataclasses.fields(config)}
    assert fields - keys == {"notes", "control_step"}


def links() -> list[tuple[Path, str]]:
    found = [(document, a or b) for document in DOCUMENTS for a, b in LINK.findall(document.read_text())]
    return [(document, link) for document, link in found if not link.startswith("http")]


@pytest.mark.parametrize(("document", "link"), links(), ids=lambda value: getattr(value, "name", value))
def test_links_lead_somewhere(document: Path, link: str):
    assert (document.parent / link).exists()


@cache
def headings(document: Path) -> set[str]:
    """What links to the headings of a document end with, as on GitHub."""
    text = re.sub(r"^```.*?^```", "", document.read_text(), flags=re.MULTILINE | re.DOTALL)
    plain = (
        re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", line).lower() for line in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    )
    return {re.sub(r"[^\w\- ]", "", line).replace(" ", "-") for line in plain}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_to_headings_lead_to_one(document: Path):
    """Sphinx does not look at them."""
    for place, heading in re.findall(r"\]\((?!http)([^)\s#]*)#([^)\s]+)\)", document.read_text()):
        assert heading in headings((document.parent / place).resolve() if place else document), f"{place}#{heading}"


def test_pictures_are_shown_and_small_and_none_is_missing():
    shown = {(document.parent / link).resolve() for document, link in links() if link.endswith((".png", ".gif"))}
    made = {*pictures.PICTURES, *(f"simulator-{name}" for name in accuracy.pictures.PICTURES)}
    files = sorted((ROOT / "docs" / "images").iterdir())
    assert {path.resolve() for path in files} == shown
    assert made - {path.stem for path in files} == set()
    limits = {".png": 200_000, ".gif": 300_000}
    assert [path.name for path in files if path.stat().st_size > limits[path.suffix]] == []


def test_the_reference_has_every_public_name():
    pages = "".join(page.read_text() for page in (ROOT / "docs" / "reference").iterdir())
    documented = set(re.findall(r"^\.\. auto\w+:: cableway\.(\w+)$", pages, re.MULTILINE))
    assert set(cableway.__all__) - documented == set()


def test_the_readme_shows_only_commands_and_targets_that_exist(capsys: pytest.CaptureFixture[str]):
    from cableway.cli import main

    text = (ROOT / "README.md").read_text()
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    commands = set(re.findall(r"^(?:\$ )?cableway (\w+)", text, re.MULTILINE))
    assert commands
    assert {name for name in commands if not re.search(rf"\b{name}\b", shown)} == set()
    makefile = (ROOT / "Makefile").read_text()
    assert {name for name in re.findall(r"\bmake (\w+)", text) if not re.search(rf"^{name}:", makefile, re.M)} == set()


def test_the_page_on_failures_has_every_outcome_and_exit_status():
    page = (ROOT / "docs" / "when-it-fails.md").read_text()
    rows = {name for row in re.findall(r"^\| ([^|]+) \|", page, re.MULTILINE) for name in row.split(", ")}
    assert {*map(str, Outcome), *map(str, (DONE, FAILED, WRONG_INPUT, INTERRUPTED))} <= rows
