"""Build the wheel ``springgym-kernels``: compiled code of the environments, for their first step at once.

    python tools/kernels.py                          # all environments, into dist/
    python tools/kernels.py SpringTop-v0 --jobs 4    # some of them

Code is compiled for all levels that this processor has: run this on one with AVX-512, which has all of them.
It is compiled by the Python, NumPy and Numba that run this script, and the wheel asks for the same ones.
Its tags are those of Numba's own wheel. `springgym.core.compiler.cache` finds it where it is installed.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Sequence
from email import message_from_string
from pathlib import Path

from springgym.core.compiler.cache import KERNELS, MADE, made_here
from springgym.core.compiler.targets import LEVELS, features

ROOT = Path(__file__).resolve().parents[1]
NAME = KERNELS.replace("_", "-")
ABOUT = """Compiled code of the environments of springgym, so that their first step does not wait for a
compiler. `pip install "springgym[compiled]"` installs it, and springgym finds it without being told.
"""


def tags() -> tuple[str, str, str]:
    """Return the tags of Numba's wheel: interpreter, ABI and platforms.

    Raises
    ------
    ValueError
        If Numba was not installed from a wheel.
    """
    told = message_from_string(importlib.metadata.distribution("numba").read_text("WHEEL") or "")
    found = [tuple(tag.split("-")) for tag in told.get_all("Tag", [])]
    if not found:
        raise ValueError("Numba has no tags: install it from a wheel")
    interpreter, abi, _ = found[0]
    return interpreter, abi, ".".join(platform for *_, platform in found)


def metadata() -> str:
    """Return the metadata of the wheel, which asks for the versions that its code is made for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    versions = made_here()
    major, minor = sys.version_info[:2]
    lines = [
        "Metadata-Version: 2.4",
        f"Name: {NAME}",
        f"Version: {versions['springgym']}",
        "Summary: Compiled code of springgym's environments",
        f"Author: {project['authors'][0]['name']}",
        f"License-Expression: {project['license']}",
        *(f"Project-URL: {name}, {url}" for name, url in project.get("urls", {}).items()),
        f"Requires-Python: =={major}.{minor}.*",
        *(f"Requires-Dist: {name.lower()}=={versions[name]}" for name in ("springgym", "NumPy", "Numba")),
        "Description-Content-Type: text/markdown",
    ]
    return "\n".join(lines) + f"\n\n{ABOUT}"


def pack(package: Path, out: Path) -> Path:
    """Write the wheel of a package of compiled code into a folder, and return its path."""
    kind = tags()
    version = made_here()["springgym"]
    info = f"{KERNELS}-{version}.dist-info"
    files = {f"{KERNELS}/{path.name}": path.read_bytes() for path in sorted(package.iterdir())}
    wheel = ["Wheel-Version: 1.0", f"Generator: {NAME}", "Root-Is-Purelib: false"]
    wheel += [f"Tag: {kind[0]}-{kind[1]}-{platform}" for platform in kind[2].split(".")]
    files[f"{info}/METADATA"] = metadata().encode()
    files[f"{info}/WHEEL"] = ("\n".join(wheel) + "\n").encode()
    record = ""
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record += f"{name},sha256={digest},{len(content)}\n"
    files[f"{info}/RECORD"] = f"{record}{info}/RECORD,,\n".encode()
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{KERNELS}-{version}-{'-'.join(kind)}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in files.items():  # without times and owners: the same code, the same wheel
            about = zipfile.ZipInfo(name)
            about.compress_type = zipfile.ZIP_DEFLATED
            about.external_attr = 0o100644 << 16
            archive.writestr(about, content)
    return path


def describe(package: Path, levels: Sequence[str]) -> None:
    """Write into a package of compiled code what it is made for."""
    (package / "__init__.py").write_text(f'"""{ABOUT}"""\n', encoding="utf-8")
    made = {"versions": made_here(), "levels": list(levels)}
    (package / MADE).write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("ids", nargs="*", metavar="ID", help="environments to compile (default: all)")
    parser.add_argument(
        "--cpu", nargs="+", choices=LEVELS, help="levels of processors (default: all that this one has)"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="environments at once")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", metavar="FOLDER", help="for the wheel")
    options = parser.parse_args(arguments)
    has = features()
    levels = options.cpu or [level for level, needs in LEVELS.items() if all(map(has.get, needs))]
    if missing := sorted(LEVELS.keys() - set(levels)):
        print(f"kernels.py: the wheel will have no code for {', '.join(missing)}", file=sys.stderr)
    if not levels:
        return 2
    package = ROOT / "build" / "kernels" / KERNELS
    shutil.rmtree(package, ignore_errors=True)
    for level in levels:
        print(f"== {level}", flush=True)
        command = [sys.executable, "-m", "springgym", "compile", *options.ids, "--cpu", level]
        command += ["--to", str(package), "--jobs", str(options.jobs)]
        done = subprocess.run(command, cwd=ROOT)
        if done.returncode:
            return done.returncode
    describe(package, levels)
    wheel = pack(package, options.out)
    print(f"{wheel}: {wheel.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
