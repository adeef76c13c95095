"""All experiments' rows as one table.

    summary.py OUT

Reads OUT/*.row, of which each holds the lines of one experiment, in the order of the figures' and tables' numbers.
"""

import re
import sys
from pathlib import Path

HEADER = "| target | dissertation | this project, published method | this project, all on | bound |"


def place(path):
    """Figures before tables before the rest; numbers as numbers."""
    kinds = ["fig", "table"]
    kind = path.stem.split("-")[0]
    numbers = [int(number) for number in re.findall(r"\d+", path.stem)]
    return (kinds.index(kind) if kind in kinds else len(kinds), numbers, path.stem)


def main():
    print(HEADER)
    print("| --- | --- | --- | --- | --- |")
    for path in sorted(Path(sys.argv[1]).glob("*.row"), key=place):
        print(path.read_text().strip())


main()
