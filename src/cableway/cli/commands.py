"""All commands, and reading a command line."""

from __future__ import annotations

import tyro

from cableway.cli.bench import Bench
from cableway.cli.calibrate import Calibrate
from cableway.cli.check import Check
from cableway.cli.collect import Collect
from cableway.cli.evaluate import Evaluate
from cableway.cli.export import Export
from cableway.cli.import_scene import Import
from cableway.cli.models import Models
from cableway.cli.options import Options
from cableway.cli.plan import Plan
from cableway.cli.reproduce import Reproduce
from cableway.cli.run import Run
from cableway.cli.see import See
from cableway.cli.show import Show
from cableway.cli.studio import Studio
from cableway.cli.tasks import Tasks
from cableway.cli.train import Train
from cableway.cli.warm_up import WarmUp
from cableway.core.errors import printable

DESCRIPTION = """A cable's way through clutter: plan how two grippers lead a cable past obstacles, and lead it there.

Exit status: 0 done and the task succeeded, 1 done but it did not, 2 the input was wrong, 130
interrupted, 143 terminated."""

Command = (
    Tasks
    | Show
    | Plan
    | Run
    | See
    | Calibrate
    | Import
    | Check
    | Studio
    | Export
    | Collect
    | Train
    | Evaluate
    | Models
    | Bench
    | Reproduce
    | WarmUp
)


def parse(arguments: list[str]) -> Options:
    """The command that a command line asks for.

    Raises:
        SystemExit: It asks for help (status 0), or it cannot be read (status 2).
    """
    shown = [printable(argument) for argument in arguments]
    if shown != arguments:
        _parsed(shown)  # ends here if it cannot be read, with a message that steers no terminal
    return _parsed(arguments)


def _parsed(arguments: list[str]) -> Options:
    return tyro.cli(
        Command,  # pyright: ignore[reportArgumentType]
        prog="cableway",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
    )
