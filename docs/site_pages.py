"""Pages of the documentation that are made while it is built: the reference of the commands, from the command line.

A hook of MkDocs (see mkdocs.yml).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
SHOWN = ("__init__.py", "api.py", "lab")  # what the reference of the Python API shows
COMMANDS = "reference/commands.md"
HEAD = """# Commands

Made from the command line itself; `rigtwin COMMAND --help` prints the same. Every quantity takes its unit (`6.2mm`,
`240Hz`, `3rpm`). Exit code 0: done; 2: the input cannot be used, one sentence says what to do; 130: interrupted; 1: a
fault of rigtwin itself.
"""


def on_startup(**_: Any) -> None:
    """Link what is shown of the package, for the reader of docstrings: it would read all of the root's folders.

    Before the plugins are configured: mkdocstrings leaves out search paths that do not exist yet.
    """
    package = ROOT / "out" / "docs" / "rigtwin"
    package.mkdir(parents=True, exist_ok=True)
    for name in SHOWN:
        (package / name).unlink(missing_ok=True)
        (package / name).symlink_to(ROOT / name)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the reference of the commands."""
    files.append(File.generated(config, COMMANDS, content=commands_page()))
    return files


def commands_page() -> str:
    """The reference of all commands, in the order of ``rigtwin --help``."""
    from rigtwin.cli import app

    root: Any = typer.main.get_command(app)
    return "\n".join([HEAD, *(line for name, one in root.commands.items() for line in _section(name, one, 2))])


def _section(name: str, command: Any, level: int) -> Iterator[str]:
    if hasattr(command, "commands"):
        yield f"\n{'#' * level} rigtwin {name}\n\n{_plain(command.help)}"
        for inner, one in command.commands.items():
            yield from _section(f"{name} {inner}", one, level + 1)
        return
    context = typer.Context(command, info_name=f"rigtwin {name}")
    usage = " ".join(command.collect_usage_pieces(context))
    yield f"\n{'#' * level} rigtwin {name}\n\n{_plain(command.help)}\n\n```text\nrigtwin {name} {usage}\n```\n"
    rows = [row for parameter in command.params if (row := _row(parameter, context)) is not None]
    yield "\n".join(["| option | meaning |", "|---|---|", *rows])
    if command.epilog:
        yield f"\n{command.epilog.replace('Example: ', 'Example: `', 1)}`"


def _row(parameter: Any, context: typer.Context) -> str | None:
    """One row of the table; None for what is not shown."""
    record = parameter.get_help_record(context)
    if record is None:
        return None
    shown, said = record
    return f"| `{_cell(shown)}` | {_cell(_plain(said))} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _plain(text: str | None) -> str:
    """Text in which no character is markup."""
    return (text or "").strip().replace("<", "&lt;").replace("*", "\\*").replace("[", "\\[")
