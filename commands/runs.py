"""``rigtwin runs STORE``: what a store of runs holds; show, drop and export runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rigtwin.commands.display import print_json, show_run, show_runs
from rigtwin.commands.options import Json, Quiet
from rigtwin.lab.formatting import counted

if TYPE_CHECKING:
    from rigtwin.compare.campaign.store import Kept, Store

Action = Literal["list", "show", "drop", "export"]


def runs(
    folder: Annotated[Path, typer.Argument(metavar="STORE", help="The store's folder, or the one above its runs/.")],
    action: Annotated[Action, typer.Argument(metavar="ACTION", help="list, show, drop or export.")] = "list",
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Runs, by name or key; for export FILE.parquet or FILE.csv."),
    ] = None,
    *,
    failed: Annotated[bool, typer.Option("--failed", help="Drop all runs that failed, and damaged rows.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """List, show, drop or export the runs of a store.

    A store is the folder `runs` in which compare, sweep, calibrate and reproduce keep finished runs. A dropped run is
    computed again when it is needed.
    """
    from rigtwin.compare.campaign.store import Store
    from rigtwin.lab.errors import BadInput

    given = names or []
    if failed and action != "drop":
        raise BadInput(f"--failed: belongs to drop, not to {action}; leave it out.")
    if action == "list" and given:
        raise BadInput(f"{given[0]!r}: list takes no names; use show {given[0]}.")
    if action in ("show", "export") and len(given) != 1:
        wanted = "one name or key of a run" if action == "show" else "one file, FILE.parquet or FILE.csv"
        raise BadInput(f"{action}: takes {wanted}, and {len(given)} were given.")
    if action == "drop" and not given and not failed:
        raise BadInput("drop: name the runs to drop, or give --failed.")
    with Store(_place(folder), create=False) as store:
        damaged = store.damaged()
        if action == "list":
            show_runs(store.rows(), damaged, as_json, quiet)
        elif action == "show":
            row = _row(store, given[0])
            try:
                result = store.result(row.key)
            except KeyError:  # of a damaged ledger
                raise BadInput(
                    f"{store.folder}: the ledger does not find the run {row.key!r}; put a copy of the store back."
                ) from None
            show_run(row, result, as_json, quiet)
        elif action == "drop":
            kept = [row for row in store.rows() if row.state == "failed"] if failed else []
            dropped = {row.key: row for row in (*(_row(store, name) for name in given), *kept)}
            store.drop(tuple(dropped))
            unread = store.drop_damaged() if failed else 0
            also = f" and {counted(unread, 'damaged row')}" if unread else ""
            words = f"Dropped {counted(len(dropped), 'run')}{also}."
            _print({"dropped": sorted(dropped), "damaged_rows": unread}, words, as_json, quiet)
        else:
            count = store.export(Path(given[0]))
            _print({"file": given[0], "runs": count}, f"Wrote {counted(count, 'run')} to {given[0]}.", as_json, quiet)
        if damaged and not (failed or as_json or quiet):
            rows = counted(damaged, "row")
            advice = "such runs are computed again; drop --failed removes them, and the failed runs"
            typer.echo(
                f"{store.folder}: {rows} of the ledger cannot be read, or changed after they were kept; {advice}.",
                err=True,
            )


def _place(folder: Path) -> Path:
    """The store itself, where `folder` holds one in ``runs``; refused where folders in it hold one."""
    from rigtwin.compare.campaign.store import LEDGER
    from rigtwin.lab.errors import BadInput

    if (folder / LEDGER).is_file() or not folder.is_dir():
        return folder
    if (folder / "runs" / LEDGER).is_file():
        return folder / "runs"
    if found := sorted(folder.glob(f"*/runs/{LEDGER}")):
        raise BadInput(f"{folder}: is no store of runs; name {' or '.join(str(one.parent.parent) for one in found)}.")
    return folder


def _row(store: Store, name: str) -> Kept:
    """The run with this key or this name."""
    from rigtwin.lab.errors import BadInput

    rows = store.rows()
    found = [row for row in rows if row.key == name] or [row for row in rows if row.name == name]
    if not found:
        raise BadInput(f"{name!r}: is neither the name nor the key of a run in {store.folder}; `list` shows them.")
    if len(found) > 1:
        keys = ", ".join(row.key for row in found)
        raise BadInput(f"{name!r}: {len(found)} runs have this name; give the key of one: {keys}.")
    return found[0]


def _print(document: dict[str, Any], words: str, as_json: bool, quiet: bool) -> None:
    if as_json:
        print_json(document)
    elif not quiet:
        typer.echo(words)
