"""A study's tables are kept on their page and in its data; the same command replaces what it printed before."""

from __future__ import annotations

import json

import printed_page

PAGE = "# All\n\nText.\n\n## Speed\n\nFast.\n\n## Size\n\nSmall.\n"


def entry(command: str, cell: str) -> dict:
    tables = [{"title": "Speed", "rows": printed_page.tables(f"said\n| a | b |\n|---|---|\n| {cell} | |\ndone\n")[0]}]
    return {"title": "Speed", "command": command, "commit": "0123456789abcdef", "tables": tables}


def test_tables_go_below_their_heading_and_the_same_command_replaces_them():
    page = printed_page.placed(printed_page.placed(PAGE, entry("one", "1")), entry("two", "2"))
    page = printed_page.placed(page, entry("one", "3"))
    shown = printed_page.tables(page)
    assert shown == [[["a", "b"], ["3", ""]], [["a", "b"], ["2", ""]]]
    assert page.index("Fast.") < page.index("`one`, commit 0123456789:") < page.index("`two`") < page.index("## Size")
    assert page.replace(printed_page.block(entry("one", "3")) + "\n", "").replace(
        printed_page.block(entry("two", "2")) + "\n", ""
    ) == PAGE  # fmt: skip


def test_data_keep_what_the_page_shows_in_its_order():
    entries = [entry("gone", "0"), entry("two", "2"), entry("one", "1")]
    page = printed_page.placed(printed_page.placed(PAGE, entries[2]), entries[1])
    assert [each["command"] for each in printed_page.kept(entries, page)] == ["one", "two"]


def test_a_study_is_run_and_kept(tmp_path, monkeypatch):
    study = tmp_path / "study.py"
    study.write_text("print('| n |\\n|---|\\n| 5 |')")
    (tmp_path / "sizes.md").write_text(PAGE)
    monkeypatch.setattr(printed_page, "RESULTS", tmp_path)
    monkeypatch.setattr("sys.argv", ["printed_page.py", "sizes", "Size", str(study)])
    printed_page.main()
    (kept,) = json.loads((tmp_path / "sizes.json").read_text())["sections"]
    assert kept["tables"] == [{"title": "Size", "rows": [["n"], ["5"]]}]
    assert printed_page.made_by(kept) in (tmp_path / "sizes.md").read_text()
    assert {"commit", "versions", "machine"} <= set(kept)
