"""Put what benchmarks found into the package's file of figures, from which tables, pages and `tasks show` are made.

.venv/bin/python scripts/figures.py results/*.json

Each file is what `gensim2 benchmark --json FILE` wrote. A row takes the place of one of the same task and condition;
with `--only`, rows that no given file holds are dropped.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gensim2.errors import InputError
from gensim2.evaluation.figures import rows_of
from gensim2.files import write_json
from gensim2.tasks import figures as stored

FILE = Path(stored.__file__).with_name(stored.FIGURES)


def main() -> None:
    """Read the arguments and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+", help="JSON files of gensim2 benchmark")
    parser.add_argument("--only", action="store_true", help="keep no other rows")
    parser.add_argument("--out", type=Path, default=FILE, help="file of figures  [default: the package's]")
    options = parser.parse_args()
    try:
        rows = [row for path in options.results for row in rows_of(path)]
        fresh = options.only or not options.out.exists()
        before = stored.Figures(schema_version=1, rows=()) if fresh else stored.read_figures(options.out)
        keys = [(row.task, row.condition) for row in rows]
        if len(set(keys)) < len(keys):
            raise InputError("two of the files have the same task under the same condition", field="results")
        found = before.with_rows(rows)
        write_json(options.out, found.model_dump(mode="json"))
    except InputError as error:
        sys.exit(f"figures: {error}")
    print(f"{len(rows)} rows in, {len(found.rows)} in {options.out}")


if __name__ == "__main__":
    main()
