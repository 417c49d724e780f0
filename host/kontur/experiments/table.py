# SPDX-License-Identifier: Apache-2.0
"""Rows of a sweep or an experiment as one table, in CSV and Parquet."""

from __future__ import annotations

import csv
import importlib.util
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from kontur.files import write_atomically

_TEXTS = ("problem", "unstable")  # columns that may be empty throughout


def write(rows: Sequence[Mapping[str, Any]], file: Path) -> list[Path]:
    """Write the table as `file` (.csv), and beside it as .parquet where pyarrow is installed (the extra `sweep`).

    Returns what was written. A value within a value gets a column with both names, `x.mass_kg`. Numbers have all their
    digits. An empty cell is not known. Raises FileError.
    """
    flat = [dict(_cells("", row)) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    columns = {name: [row.get(name) for row in flat] for name in names}
    write_atomically(file, _csv_bytes(columns))
    if importlib.util.find_spec("pyarrow") is None:
        return [file]
    parquet = file.with_suffix(".parquet")
    write_atomically(parquet, _parquet_bytes(columns))
    return [file, parquet]


def _cells(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, (Mapping, list, tuple)):
        for key, inner in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield from _cells(f"{name}.{key}" if name else str(key), inner)
    else:
        yield name, value


def _csv_bytes(columns: Mapping[str, Sequence[Any]]) -> bytes:
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(columns)
    table.writerows(zip(*columns.values(), strict=True))
    return out.getvalue().encode()


def _parquet_bytes(columns: Mapping[str, Sequence[Any]]) -> bytes:
    import pyarrow
    import pyarrow.parquet

    out = io.BytesIO()
    arrays = {name: _array(name, values) for name, values in columns.items()}
    pyarrow.parquet.write_table(pyarrow.table(arrays), out)
    return out.getvalue()


def _array(name: str, values: Sequence[Any]) -> Any:
    """A column. A kind that the values do not tell is given, so that files of several sweeps can be read as one."""
    import pyarrow

    if all(value is None for value in values):
        return pyarrow.array(values, pyarrow.string() if name.rpartition(".")[2] in _TEXTS else pyarrow.float64())
    if any(isinstance(value, float) for value in values):
        return pyarrow.array([None if value is None else float(value) for value in values])
    return pyarrow.array(values)
