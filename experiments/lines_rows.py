"""The rows of tables 4.1 and 4.4 from what `cargo bench --bench lines_table` prints.

    lines_rows.py ROWS TABLE.txt

Only what does not depend on the machine: of the first table the shares of true and false lines, of the second how
many cells and votes the modified Hough transform has of the whole one's. The times stay in TABLE.txt.
"""

import re
import sys
from pathlib import Path


def main():
    rows, table = Path(sys.argv[1]), Path(sys.argv[2]).read_text()
    # NAME [+clust] and six published figures or - | hz lines true false sigma_d sigma_alpha ratio
    ours, published = {}, {}
    for line in table.splitlines():
        left, bar, right = line.partition("|")
        left, right = left.split(), right.split()
        if not bar or len(right) != 7 or not re.fullmatch(r"[\d.]+", right[0]):
            continue
        name = " ".join(left[:2] if "+clust" in left else left[:1])
        ours[name] = right
        if left[-1] != "-":
            published[name] = left[-6:]

    def shares(figures):
        return f"true {figures[2]} %, false {figures[3]} %"

    best = max(ours, key=lambda name: float(ours[name][2]) - float(ours[name][3]))
    split = next(name for name in published if name.startswith("split-and-merge"))
    hough = [name for name in published if name.startswith("hough")][-1]
    modified = next(name for name in ours if name.startswith("modified-hough"))
    cells = [
        "table-4-1",
        f"split-and-merge: {shares(published[split])}; Hough: {shares(published[hough])}",
        f"modified Hough: {shares(ours[modified])}; Hough: {shares(ours[hough])}",
        f"{best}: {shares(ours[best])}",
        "true 100 %, false 0 %",
    ]
    (rows / "table-4-1.row").write_text(f"| {' | '.join(cells)} |\n")
    figures = re.search(r"^three windows / whole space: +([\d.]+)% +([\d.]+)%", table, re.MULTILINE)
    cells = [
        "table-4-4",
        "modified Hough: 1 % of the cells, 76 % of the time",
        f"{figures[1]} % of the cells, {figures[2]} % of the votes",
        "the same",
        "",
    ]
    (rows / "table-4-4.row").write_text(f"| {' | '.join(cells)} |\n")


main()
