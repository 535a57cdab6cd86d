"""Run the notebooks, and write their outputs into their files; the site shows these.

    python docs/notebooks.py                 # all of docs/notebooks
    python docs/notebooks.py top.ipynb

Cells with the tag ``skip-execution`` are left out: they install the package where it is missing. Needs the
extras ``docs``, ``agents``, ``scenes``, ``plot`` and ``render``.
"""

from __future__ import annotations

import os
import sys
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

HERE = Path(__file__).resolve().parent
FOLDER = HERE / "notebooks"
SKIPPED = "skip-execution"
"""Tag of the cells that are not run; nbclient knows it, too."""


def code_cells(notebook: dict[str, Any]) -> list[str]:
    """Return the source of each code cell that is run."""
    return [
        "".join(cell["source"])
        for cell in notebook["cells"]
        if cell["cell_type"] == "code" and SKIPPED not in cell["metadata"].get("tags", [])
    ]


def digest(notebook: dict[str, Any]) -> str:
    """Return the SHA-256 of the code. The file holds that of the code which gave its outputs."""
    return sha256("\n\n".join(code_cells(notebook)).encode()).hexdigest()


def run(path: Path) -> None:
    """Run a notebook in an empty folder, and write it with its outputs."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        client = NotebookClient(notebook, timeout=600, record_timing=False, coalesce_streams=True)
        client.execute(cwd=folder)
    notebook.metadata["springgym"] = {"code": digest(notebook)}
    nbformat.write(notebook, path)
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def main(names: list[str]) -> int:
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(HERE.parent), os.environ.get("PYTHONPATH")]))
    for path in [FOLDER / name for name in names] or sorted(FOLDER.glob("*.ipynb")):
        run(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
