"""Write docs/verification.md from the figures of `make verify`.

    python benchmarks/engine/verification_page.py [out/verify.json]

One row for each figure, those included of which nothing is wanted.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "verification.md"
HEAD = """# Verification of the engine

The DEM engine against closed forms, published single-contact benchmarks (tests 1 to 8 are those of Chung and Ooi 2011,
doi 10.1007/s10035-011-0277-0), separately integrated contacts, and LIGGGHTS. Written by
`benchmarks/engine/verification_page.py` from `make verify`, on {processor} with Python {python}; {passed} of {judged}
wanted figures were reached. Deviations are relative to the reference, or absolute where that is zero.

Other evidence: [published tables](reproduction.md) of a paper beside the twins, [decks](other_codes.md) that LIGGGHTS,
LAMMPS and Yade ran, the [diagnosis](diagnosis.md) on public data.

| figure | ours | reference | deviation | wanted | reached | reference is |
|---|---|---|---|---|---|---|
"""


def page(document: dict[str, Any]) -> str:
    judged = [row for row in document["rows"] if row["passed"] is not None]
    head = HEAD.format(
        processor=document["machine"]["processor"],
        python=document["machine"]["python"],
        passed=sum(row["passed"] for row in judged),
        judged=len(judged),
    )
    return head + "\n".join(_lines(document["rows"])) + "\n"


def _lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    for row in rows:
        unit = "" if row["unit"] == "1" else f" {row['unit']}"
        reference = "" if row["reference"] is None else f"{row['reference']:.5g}{unit}"
        off = row["deviation"]
        deviation = "" if off is None else f"{off:+.2%}" if row["reference"] else f"{off:+.2g}"
        reached = {True: "yes", False: "**no**", None: ""}[row["passed"]]
        cells = (row["name"], f"{row['value']:.5g}{unit}", reference, deviation, row["wanted"], reached, row["note"])
        yield f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def main() -> int:
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "out" / "verify.json"
    PAGE.write_text(page(json.loads(source.read_text("utf-8"))), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
