"""Check what the main job left: figures and a results table, none empty, and an installation that holds only sdhj.

Usage: python check_main_job.py RESULTS ENVIRONMENT
"""

import sys
from pathlib import Path

FIGURES = {".pdf", ".png", ".svg"}
TABLES = {".csv", ".md"}


def faults(results: Path, environment: Path) -> list[str]:
    """One line for each thing that is missing, empty or in the wrong place."""
    found = []
    files = [path for path in results.rglob("*") if path.is_file()] if results.is_dir() else []
    for kind, suffixes in (("figure", FIGURES), ("results table", TABLES)):
        if not any(path.suffix in suffixes for path in files):
            found.append(f"no {kind} ({', '.join(sorted(suffixes))}) under {results}")
    found += [f"{path} is empty" for path in files if path.stat().st_size == 0]
    records = list(environment.glob("lib/python*/site-packages/sdhj-*.dist-info/RECORD"))
    if len(records) != 1:
        found.append(f"expected one installation of sdhj in {environment}, found {len(records)}")
    for record in records:
        installed = [line.rsplit(",", 2)[0] for line in record.read_text(encoding="utf-8").splitlines()]
        tops = {name.split("/")[0] for name in installed if not name.endswith("bin/sdhj")}
        found += [
            f"the installation has {top} beside the package" for top in sorted(tops - {"sdhj", record.parent.name})
        ]
    return found


if __name__ == "__main__":
    lines = faults(Path(sys.argv[1]), Path(sys.argv[2]))
    print("\n".join(lines) if lines else f"results and installation are as they should be: {sys.argv[1]}")
    sys.exit(bool(lines))
