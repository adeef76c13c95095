"""Puts rows of the experiments' summary into README.md, between the two comments that mark the place.

    headline.py README.md OUT TARGET..

Ends with status 1 where the marks or a row are missing.
"""

import sys
from pathlib import Path

BEGIN, END = "<!-- headline: made by `make headline` -->", "<!-- end of headline -->"
HEADER = "| `make -C experiments ..` | dissertation | this project, published method | this project, all on | bound |"


def main():
    readme, out, *targets = sys.argv[1:]
    rows = []
    for target in targets:
        row = Path(out, f"{target}.row")
        if not row.is_file():
            sys.exit(f"{row} is missing; `make experiments` makes it")
        rows.append(row.read_text().strip())
    text = Path(readme).read_text()
    head, mark, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (mark and end):
        sys.exit(f"{readme} has no place between {BEGIN} and {END}")
    table = "\n".join([HEADER, "| --- | --- | --- | --- | --- |", *rows])
    Path(readme).write_text(f"{head}{BEGIN}\n{table}\n{END}{tail}")


main()
