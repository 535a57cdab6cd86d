"""Build the site: films and figures, notebooks, pages. A warning is an error.

    python docs/build.py                    # into docs/_build/html
    python docs/build.py --no-media         # without films and figures of scenes, in a minute

Needs the extras ``docs``, ``agents`` and ``scenes``; no network, and no other host once it is built.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent


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
    if not options.no_media:
        from media import make_all

        make_all(HERE / "_media")
    from sphinx.cmd.build import main as sphinx

    doctrees = HERE / "_build" / "doctrees"
    status = sphinx(["-E", "-W", "--keep-going", "-d", str(doctrees), str(HERE), str(options.out)])
    if status == 0:
        print(f"open {options.out / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
