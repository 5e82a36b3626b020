"""Laws of the stage timer and of the progress display."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cableway.cli import terminal
from cableway.cli.options import Options
from cableway.cli.terminal import Terminal, pairs
from cableway.workflow.find import StageTimer


def test_every_second_is_counted_to_one_stage():
    now, reported = [100.0], []
    timer = StageTimer(lambda stage, share: reported.append((stage, share)), clock=lambda: now[0])
    for wait, stage, share in (
        (1.0, "a", 0.0),  # before the first word: to a
        (2.0, "a", 0.5),
        (4.0, "a", 1.0),
        (8.0, "b", 0.0),  # between two stages: to the one that begins
        (16.0, "c", 0.0),  # b never said that it ended
        (32.0, "c", 1.0),
        (64.0, "b", 0.0),
    ):
        now[0] += wait
        timer(stage, share)
    now[0] += 128.0  # b failed
    timer.stop()
    timer.stop()
    assert timer.seconds == {"a": 7.0, "b": 8.0 + 16.0 + 64.0 + 128.0, "c": 32.0}
    assert sum(timer.seconds.values()) == now[0] - 100.0
    assert reported[:2] == [("a", 0.0), ("a", 0.5)]


def test_progress_goes_to_stderr_and_each_stage_has_one_line(capsys: pytest.CaptureFixture[str]):
    with Terminal(Options()).progress() as report:
        for stage, share in (("dig", 0.0), ("dig", 1.0), ("train: epoch 1", 0.3), ("train: epoch 2", 1.0)):
            report(stage, share)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert [line.split()[0] for line in shown.err.splitlines()] == ["dig", "train"]
    assert "epoch 2" in shown.err
    assert shown.err.count("100%") == 2


def test_what_goes_on_for_long_is_said_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """A line every ten seconds, by a clock of which every reading is 4 s later."""
    seconds = iter(range(0, 1000, 4))
    monkeypatch.setattr(terminal, "time", SimpleNamespace(monotonic=lambda: next(seconds)))
    with Terminal(Options()).progress() as report:
        for count in range(1, 7):
            report(f"compile: {count} of 61", count / 61)
            said = capsys.readouterr().err
            assert said == (f"compile {count} of 61 {count / 61:.0%}\n" if count in (3, 6) else "")


def test_quiet_is_quiet_and_json_is_json(capsys: pytest.CaptureFixture[str]):
    for options in (Options(quiet=True), Options(json=True)):
        shell = Terminal(options)
        with shell.progress() as report:
            report("dig", 1.0)
        shell.note("by the way")
        shell.result({"a": 1}, "table")
        shown = capsys.readouterr()
        assert shown.out == ("" if options.quiet else '{\n "a": 1\n}\n')
        assert (shown.err == "") == options.quiet


def test_texts_from_files_cannot_command_the_terminal(capsys: pytest.CaptureFixture[str]):
    """A name with escapes in it is shown with the escapes as text, whether in a table or in a note."""
    hostile = "\x1b[31mred \u202eright"
    terminal = Terminal(Options())
    terminal.note(hostile)
    terminal.result({}, pairs([("name", hostile)]))
    printed = capsys.readouterr()
    assert r"\x1b[31mred \u202eright" in printed.out
    assert r"\x1b[31mred \u202eright" in printed.err
