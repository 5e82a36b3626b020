"""The `cableway` command: parse, run one command, turn errors into one sentence and an exit status."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from cableway.cli.interrupts import INTERRUPTS
from cableway.core.errors import FULL, CablewayError, InputError, printable, said

if TYPE_CHECKING:
    from cableway.cli.options import Options

DONE, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses: succeeded; done, but the task did not succeed; the input was wrong; ctrl-c (a SIGTERM: 143)."""

LONGEST = 980
"""Letters of a sentence, by and large."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: What follows the program's name; from the process where None.

    Returns:
        The exit status.
    """
    # Nothing is drawn with MuJoCo, which asks a process of its own for the version of the graphics it finds: one that
    # ctrl-c ends with a traceback.
    os.environ.setdefault("MUJOCO_GL", "disable")
    with INTERRUPTS.handled(last=argv is None):
        try:
            sentence, status = INTERRUPTS.carry_out(lambda: _run(list(sys.argv[1:] if argv is None else argv)))
        except BaseException as error:  # an interrupt comes out of an import as whatever the module makes of it
            if not (INTERRUPTS.came or isinstance(error, KeyboardInterrupt)):
                raise
            sentence, status = INTERRUPTS.sentence, INTERRUPTED
    if INTERRUPTS.came:
        sentence, status = INTERRUPTS.sentence, INTERRUPTS.status
    if sentence:
        print(f"cableway: {_one_line(sentence)}", file=sys.stderr)
    return status


def _one_line(sentence: str) -> str:
    """A sentence without what steers a terminal; its middle is left out where it quotes something that long."""
    text = printable(sentence).replace("\n", r"\n")
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"


def _run(arguments: list[str]) -> tuple[str, int]:
    """Carry out a command line: what is to be said about it, and the exit status."""
    try:
        if arguments == ["--version"]:
            from cableway.core.provenance import versions

            print(f"cableway {versions()['cableway']}")
            return "", DONE
        from cableway.cli.commands import parse  # here, so that an interrupt during imports is quiet too

        try:
            command = parse(arguments)
        except SystemExit as stop:  # help, or what cannot be read
            return "", stop.code if isinstance(stop.code, int) else DONE
        from cableway.cli.log import LOGGER, logged
        from cableway.core.deprecation import old_names_heard

        with logged(command, arguments), old_names_heard() as heard:
            status = command.execute()
            _tell_problems(command, heard)
            LOGGER.info("exit status %d", status)
        return "", status
    except SystemExit as stop:
        return f"the command was ended by {said(stop)}, in code that is not cableway's", FAILED
    except BrokenPipeError:
        from cableway.cli.terminal import leave_pipe

        leave_pipe()
        return "", DONE
    except InputError as error:
        return str(error), WRONG_INPUT
    except CablewayError as error:
        return str(error), FAILED
    except OSError as error:
        if error.filename is None and error.errno not in FULL:
            raise
        if error.filename is None:
            from cableway.cli.terminal import leave_pipe

            leave_pipe()
        sentence = f"{error.filename or 'standard output'}: {error.strerror}"
        return sentence, FAILED if error.errno in FULL else WRONG_INPUT


def _tell_problems(options: Options, heard: list[str]) -> None:
    """Say which names were old, and why what was compiled will be compiled again; silent where there is nothing."""
    cache = sys.modules.get("cableway.core.user_cache")
    problems = [*heard, *(cache.problems() if cache is not None else ())]
    if problems:
        from cableway.cli.terminal import Terminal

        for problem in problems:
            Terminal(options).note(problem)
