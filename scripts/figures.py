"""Put what benchmarks found into the package's file of figures, from which tables, pages and `tasks show` are made.

.venv/bin/python scripts/figures.py results/*.json
.venv/bin/python scripts/figures.py --remake DIR --assets OBJECTS [--shown]     # run what DIR lacks, then put it in
.venv/bin/python scripts/figures.py --page by_instance.html                     # each row by its episodes' objects

Each file is what `gensim2 benchmark --json FILE` wrote. A row takes the place of one of the same task and condition;
with `--only`, rows that no given file holds are dropped. The episodes of each row go into the archive, a line each.
`--remake` makes the episodes of all rows anew, one command for those that share condition and seed; a command that was
interrupted is gone on with.
"""

from __future__ import annotations

import argparse
import hashlib
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from gensim2.errors import InputError
from gensim2.evaluation.archive import put_into_archive
from gensim2.evaluation.figures import command_of, made_together, page_by_instance, rows_with_episodes
from gensim2.files import write_atomic, write_json
from gensim2.tasks import figures as stored
from gensim2.tasks.figures import Figure

FILE = Path(stored.__file__).with_name(stored.FIGURES)
ARCHIVE = Path(__file__).resolve().parents[1] / "benchmarks" / "episodes"


def main() -> None:
    """Read the arguments and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="*", help="JSON files of gensim2 benchmark")
    parser.add_argument("--only", action="store_true", help="keep no other rows")
    parser.add_argument("--remake", type=Path, metavar="DIR", help="run what made the figures, into DIR")
    parser.add_argument("--assets", metavar="DIR", help="of --remake: folder of the real objects")
    parser.add_argument("--shown", action="store_true", help="of --remake: say the commands and run none")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write a page of all rows by instance")
    parser.add_argument("--out", type=Path, default=FILE, help="file of figures  [default: the package's]")
    parser.add_argument(
        "--archive", type=Path, default=ARCHIVE, metavar="DIR", help="of episodes  [default: the project's]"
    )
    options = parser.parse_args()
    if not (options.results or options.remake or options.page):
        parser.error("give JSON files, --remake or --page")
    try:
        results = list(options.results)
        if options.remake is not None:
            results += remade(stored.read_figures(options.out).rows, options.remake, options.assets, options.shown)
        if results:
            put_in(results, options.out, options.archive, options.only)
        if options.page is not None:
            write_atomic(options.page, page_by_instance(stored.read_figures(options.out).rows))
    except InputError as error:
        sys.exit(f"figures: {error}")


def put_in(results: Sequence[Path], out: Path, archive: Path, only: bool) -> None:
    """Put the rows of benchmarks into the file of figures, and their episodes into the archive."""
    counted = [pair for path in results for pair in rows_with_episodes(path)]
    rows = [row for row, _ in counted]
    fresh = only or not out.exists()
    before = stored.Figures(schema_version=1, rows=()) if fresh else stored.read_figures(out)
    keys = [(row.task, row.condition) for row in rows]
    if len(set(keys)) < len(keys):
        raise InputError("two of the files have the same task under the same condition", field="results")
    found = before.with_rows(rows)
    put_into_archive(archive, counted)
    write_json(out, found.model_dump(mode="json"))
    print(f"{len(rows)} rows in, {len(found.rows)} in {out}")


def remade(rows: Sequence[Figure], folder: Path, assets: str | None, shown: bool) -> list[Path]:
    """Run the benchmarks of rows whose JSON is not in ``folder``; return the files, none where they are but shown."""
    commands = [command_of(group, assets) for group in made_together(rows)]
    found = []
    for words in commands:
        name = hashlib.sha256(shlex.join(words).encode()).hexdigest()[:12]
        run, file = folder / name, folder / f"{name}.json"
        line = ["gensim2", *words, "--out", str(run), "--json", str(file), *(["--resume"] if run.exists() else [])]
        if shown:
            print(shlex.join(line))
            continue
        if not file.exists():
            folder.mkdir(parents=True, exist_ok=True)
            code = subprocess.run([str(Path(sys.executable).with_name("gensim2")), *line[1:]], check=False).returncode
            if code or not file.exists():
                raise InputError(f"ended with {code}: {shlex.join(line)}", remedy="run it again: it goes on")
        found.append(file)
    return found


if __name__ == "__main__":
    main()
