"""The `cableway` command: parse, run one command, turn errors into one sentence and an exit status."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from cableway.cli.check import Check
from cableway.cli.collect import Collect
from cableway.cli.models import Models
from cableway.cli.options import Options
from cableway.cli.plan import Plan
from cableway.cli.run import Run
from cableway.cli.show import Show
from cableway.cli.tasks import Tasks
from cableway.cli.terminal import leave_pipe
from cableway.cli.train import Train
from cableway.errors import CablewayError, InputError

DONE, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses: succeeded; done, but the task did not succeed; the input was wrong; ctrl-c."""

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "1")
"""NumPy's matrices are small here: more threads make a control step wait for them instead of faster."""

DESCRIPTION = """A cable's way through clutter: plan how two grippers lead a cable past obstacles, and lead it there.

Exit status: 0 done and the task succeeded, 1 done but it did not, 2 the input was wrong, 130 interrupted."""

Command = (
    Annotated[Tasks, tyro.conf.subcommand("tasks")]
    | Annotated[Show, tyro.conf.subcommand("show")]
    | Annotated[Plan, tyro.conf.subcommand("plan")]
    | Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Collect, tyro.conf.subcommand("collect")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Models, tyro.conf.subcommand("models")]
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: What follows the program's name; from the process where None.

    Returns:
        The exit status.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    os.environ.setdefault(*ONE_THREAD)
    try:
        if arguments == ["--version"]:
            print(f"cableway {_version()}")
            return DONE
        return _parse(arguments).execute()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else DONE
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except BrokenPipeError:
        leave_pipe()
        return DONE
    except InputError as error:
        return _say(str(error), WRONG_INPUT)
    except CablewayError as error:
        return _say(str(error), FAILED)
    except OSError as error:
        if error.filename is None:
            raise
        return _say(f"{error.filename}: {error.strerror}", WRONG_INPUT)


def _parse(arguments: list[str]) -> Options:
    return tyro.cli(
        Command,  # pyright: ignore[reportArgumentType]
        prog="cableway",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
    )


def _say(sentence: str, status: int) -> int:
    print(f"cableway: {sentence}", file=sys.stderr)
    return status


def _version() -> str:
    from cableway.provenance import versions

    return versions()["cableway"]
