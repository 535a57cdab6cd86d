"""Build the site: films and figures, notebooks, pages. A warning is an error.

    python docs/build.py                    # into docs/_build/html
    python docs/build.py --no-media         # without films and figures of scenes, in a minute

Needs the extras ``docs``, ``agents`` and ``scenes``; no network, and no other host once it is built.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent


def newest(folder: Path) -> float:
    """When a file of the package was changed last."""
    return max(path.stat().st_mtime for kind in ("*.py", "*.yaml") for path in folder.rglob(kind))


def forget_notebooks() -> None:
    """Run the notebooks anew if the package has changed since: their cache knows of their own cells alone."""
    cache = HERE / "_build" / "notebooks"
    if cache.exists() and cache.stat().st_mtime < newest(ROOT / "springgym"):
        shutil.rmtree(cache)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "_build" / "html", help="folder to write to")
    parser.add_argument("--no-media", action="store_true", help="leave out films and figures of scenes")
    options = parser.parse_args()
    # the notebooks run in processes of their own: they, too, use this copy of the package
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    sys.path[:0] = [str(ROOT), str(HERE)]
    (HERE / "_media").mkdir(exist_ok=True)
    forget_notebooks()
    if not options.no_media:
        from media import make_all

        make_all(HERE / "_media", newest(ROOT / "springgym"))
    from sphinx.cmd.build import main as sphinx

    doctrees = HERE / "_build" / "doctrees"
    status = sphinx(["-E", "-W", "--keep-going", "-d", str(doctrees), str(HERE), str(options.out)])
    if status == 0:
        print(f"open {options.out / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
