"""Build the site: films, figures and pages. A warning is an error.

    python docs/build.py                    # into docs/_build/html
    python docs/build.py --no-media         # without films and figures of scenes, in a minute

The build needs the extras ``docs``, ``agents`` and ``scenes``, and no network. The site uses no other host.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent


def newest(*folders: Path) -> float:
    """Return the time of the last change of code, scenes and agents in some folders."""
    kinds = ("*.py", "*.yaml", "*.npz")
    return max(path.stat().st_mtime for folder in folders for kind in kinds for path in folder.rglob(kind))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "_build" / "html", help="folder to write to")
    parser.add_argument("--no-media", action="store_true", help="leave out films and figures of scenes")
    options = parser.parse_args()
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    sys.path[:0] = [str(ROOT), str(HERE)]
    (HERE / "_media").mkdir(exist_ok=True)
    if not options.no_media:
        from media import make_all

        make_all(HERE / "_media", newest(ROOT / "springgym", ROOT / "agents" / "trained"))
    from sphinx.cmd.build import main as sphinx

    doctrees = HERE / "_build" / "doctrees"
    status = sphinx(["-E", "-W", "--keep-going", "-d", str(doctrees), str(HERE), str(options.out)])
    if status == 0:
        print(f"open {options.out / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
