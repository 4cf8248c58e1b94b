# SPDX-License-Identifier: BSD-3-Clause
"""`python -m airslam <command>`: what the package does beyond the program `airslam`.

Each command is a module of the package with add_parser(subparsers), which adds its parser and returns
it, and main(args) -> int, which does the work and returns the exit code.
"""

import argparse
import importlib
import sys

# Command -> its module, what it does, for the help text even where its module cannot be imported, and the
# optional dependencies of pyproject.toml that it needs.
# A module must not be called like a function of the package: importing it would hide the function.
COMMANDS = {
    "run": ("run_command", "map a sequence or a bag, with a live view if wanted", "view"),
    "view": ("view", "look at a map", "view"),
    "report": ("report", "a page of pictures and plots of a run", "report"),
    "convert": ("convert", "a bag as a folder of images", "bags"),
}


def register(subparsers, command: str) -> None:
    """Adds the parser of a command; of one whose module cannot be imported, one that says why."""
    name, purpose, extra = COMMANDS[command]
    try:
        module = importlib.import_module(f"airslam.{name}")
        parser = module.add_parser(subparsers)
        parser.set_defaults(main=module.main, checks_arguments=True)
    except ImportError as error:
        parser = subparsers.add_parser(command, help=purpose, add_help=False)
        sentence = f"the command {command} needs more than is installed ({error}): pip install '.[{extra}]'"
        parser.set_defaults(main=lambda args: fail(sentence), checks_arguments=False)


def fail(sentence: str) -> int:
    print(f"airslam: {sentence}", file=sys.stderr)
    return 1


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m airslam", description=__doc__.split("\n")[0])
    subparsers = parser.add_subparsers(title="commands", metavar="<command>", required=True)
    for command in COMMANDS:
        register(subparsers, command)
    args, unknown = parser.parse_known_args(arguments)
    if unknown and args.checks_arguments:
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        return args.main(args)
    except KeyboardInterrupt:
        return fail("stopped")
    except Exception as error:  # airslam.Error, OSError, ...: one sentence each
        from airslam import Error

        if isinstance(error, (Error, OSError)):
            return fail(str(error))
        raise


if __name__ == "__main__":
    sys.exit(main())
