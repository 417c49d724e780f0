# SPDX-License-Identifier: Apache-2.0
"""Run a notebook in a kernel of its own and write its outputs: `python tools/run_notebook.py examples/python.ipynb`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

_START_S = 600  # for the kernel, on a busy machine


def read(file: Path) -> NotebookNode:
    """The notebook in `file`."""
    return nbformat.read(file, as_version=4)


def executed(notebook: NotebookNode, folder: Path) -> NotebookNode:
    """The notebook with the outputs of a new run in `folder`; nothing in it tells when that was, or on which machine.

    Raises nbclient.exceptions.CellExecutionError where a cell raises.
    """
    os.environ.pop("MPLBACKEND", None)  # so that the kernel shows pictures
    client = NotebookClient(
        notebook, startup_timeout=_START_S, timeout=None, coalesce_streams=True, record_timing=False,
        resources={"metadata": {"path": str(folder)}},
    )  # fmt: skip
    run = client.execute()
    run.metadata["language_info"] = {"name": "python"}
    return run


def texts(notebook: NotebookNode) -> list[str]:
    """All that the cells print."""
    return [out.text for cell in notebook.cells for out in cell.get("outputs", []) if out.output_type == "stream"]


if __name__ == "__main__":
    path = Path(sys.argv[1])
    nbformat.write(executed(read(path), path.parent), path)
