"""The `cableway` command: parse, run one command, turn errors into one sentence and an exit status."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from cableway.core.errors import CablewayError, InputError

DONE, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses: succeeded; done, but the task did not succeed; the input was wrong; ctrl-c."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: What follows the program's name; from the process where None.

    Returns:
        The exit status.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        if arguments == ["--version"]:
            from cableway.core.provenance import versions

            print(f"cableway {versions()['cableway']}")
            return DONE
        from cableway.cli.commands import parse  # here, so that ctrl-c during imports is quiet too

        return parse(arguments).execute()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else DONE
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except BrokenPipeError:
        from cableway.cli.terminal import leave_pipe

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


def _say(sentence: str, status: int) -> int:
    print(f"cableway: {sentence}", file=sys.stderr)
    return status
