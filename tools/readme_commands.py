"""Print the two commands of README.md, a line each: the main job and the tests.

    python3 tools/readme_commands.py           # as they stand there
    python3 tools/readme_commands.py FOLDER    # with their environment in FOLDER instead of .venv

They are its fenced ``sh`` blocks, but for those that begin with "# Optional". This needs
the standard library only.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

README = Path(__file__).resolve().parents[1] / "README.md"
ENVIRONMENT = ".venv"


def commands(page: str) -> tuple[str, str]:
    """Return the command of the main job and that of the tests.

    Raises
    ------
    ValueError
        If the page has not exactly these two, in this order, each in one line.
    """
    blocks = re.findall(r"^```sh\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    found = [block.strip() for block in blocks if not block.startswith("# Optional")]
    parts = ("springgym train ", "-m pytest")
    match found:
        case [main, tests] if "\n" not in main + tests and parts[0] in main and parts[1] in tests:
            return main, tests
    raise ValueError(f"README.md must have two commands, with {' and '.join(parts)}; it has {found}")


if __name__ == "__main__":
    for command in commands(README.read_text(encoding="utf-8")):
        print(command.replace(ENVIRONMENT, sys.argv[1]) if len(sys.argv) > 1 else command)
