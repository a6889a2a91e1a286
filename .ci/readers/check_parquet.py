"""Compares a Parquet file of `farreach rec export --to parquet`, as pyarrow reads it, with the CSV
file of the same export.

    check_parquet.py FILE.parquet FILE.csv

Every value is compared bit by bit, the types with those of the columns, and units and rig must be
in the metadata. Exit code 1 and the first differences on stderr if anything differs.
"""

import csv
import json
import struct
import sys

import pyarrow
import pyarrow.parquet

SHOWN = 10


def bits(value):
    """All NaN are equal, and -0.0 differs from 0.0."""
    return "NaN" if value != value else struct.pack("<d", value)


def main(parquet_file, csv_file):
    table = pyarrow.parquet.read_table(parquet_file)
    with open(csv_file, encoding="utf-8", newline="") as lines:
        names, *rows = csv.reader(lines)
    differences = []

    def expect(where, wanted, found):
        if wanted != found:
            differences.append(f"{where}: expected {wanted!r}, found {found!r}")

    expect("columns", names, table.column_names)
    expect("rows", len(rows), table.num_rows)
    metadata = {key.decode(): text.decode() for key, text in table.schema.metadata.items()}
    units = json.loads(metadata["units"])
    expect("columns with a unit that are not there", set(), set(units) - set(names))
    expect("a rig file", True, "[[axes]]" in metadata["farreach.rig_file"])
    for at, name in enumerate(names):
        column = table.column(name)
        kind = column.type
        if pyarrow.types.is_timestamp(kind):
            expect(f"type of {name}", pyarrow.timestamp("ns", tz="UTC"), kind)
            column = column.cast(pyarrow.int64())
        found = column.to_pylist()
        wanted = [row[at] for row in rows]
        if pyarrow.types.is_float64(kind):
            wanted, found = ([bits(float(value)) for value in values] for values in (wanted, found))
        elif not pyarrow.types.is_string(kind):
            wanted = [int(value) for value in wanted]
        if wanted != found:
            pairs = zip(wanted, found)
            row = next((row for row, (one, other) in enumerate(pairs) if one != other), "the end")
            differences.append(f"{name} ({kind}) differs from row {row} on")
    for difference in differences[:SHOWN]:
        print(difference, file=sys.stderr)
    if differences or not rows:
        print(f"{len(differences)} differences in {len(rows)} rows", file=sys.stderr)
        sys.exit(1)
    print(f"pyarrow: {len(rows)} rows of {len(names)} columns, all equal; {units}")


if __name__ == "__main__":
    main(*sys.argv[1:])
