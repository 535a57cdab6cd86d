"""Check a release, and write version, date, authors and addresses where files repeat them.

    python release.py --write              # write these into the files that repeat them
    python release.py v0.2.0               # check this tag, as the workflow does
    python release.py v0.2.0 --notes FILE  # check it, and write its section of the changelog

The version comes from ``springgym/__init__.py``, and its date from its heading in ``CHANGELOG.md``. Authors
and addresses come from ``pyproject.toml``.
"""

from __future__ import annotations

import argparse
import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlparse

ROOT = Path(__file__).resolve().parent
PLACEHOLDER = "OWNER"
"""Placeholder in the addresses of ``pyproject.toml`` until the address of the project is known."""
HEADING = re.compile(r"^## (\S+) \((.+)\)$", re.MULTILINE)
"""Heading of a version in the changelog: its number, and its date or a word such as "unreleased"."""
DATE = re.compile(r"\d{4}-\d\d-\d\d")


def text(path: str) -> str:
    """Return the text of a file of the repository."""
    return (ROOT / path).read_text(encoding="utf-8")


def version() -> str:
    """Return the version of the package."""
    (found,) = re.findall(r'^__version__ = "(.+)"$', text("springgym/__init__.py"), re.MULTILINE)
    return str(found)


def changes(number: str) -> tuple[str, str]:
    """Return the date and the changelog of a version; both are empty if it has no heading."""
    log = text("CHANGELOG.md")
    for heading in HEADING.finditer(log):
        if heading[1] == number:
            told, *_ = re.split(r"^## ", log[heading.end() :], maxsplit=1, flags=re.MULTILINE)
            return heading[2], told.strip() + "\n"
    return "", ""


def with_addresses(page: str) -> str:
    """Return a page with absolute addresses of links and pictures, in the tagged version."""
    source = tomllib.loads(text("pyproject.toml"))["project"]["urls"]["Source"]

    def whole(found: re.Match[str]) -> str:
        kind = "raw" if found[1] == 'src="' else "blob"
        return f"{found[1]}{source}/{kind}/v{version()}/{found[2]}"

    return re.sub(r'(\]\(|href="|src=")(?![a-z]+:|#)([^)"\s]+)', whole, page)


def repeated() -> dict[str, str]:
    """Return the correct text of the files that repeat version, date, authors or address."""
    project = tomllib.loads(text("pyproject.toml"))["project"]
    (author,) = (author["name"] for author in project["authors"])
    number = version()
    date, _ = changes(number)
    citation = re.sub(r"^date-released: .*\n", "", text("CITATION.cff"), flags=re.MULTILINE)
    if DATE.fullmatch(date):
        citation = re.sub(r"^(version: .*\n)", rf'\1date-released: "{date}"\n', citation, flags=re.MULTILINE)
    for key, value in {
        "  - name": author,
        "version": number,
        "repository-code": project["urls"]["Source"],
        "url": project["urls"]["Homepage"],
    }.items():
        citation = re.sub(rf"^{key}: .*$", f"{key}: {value}", citation, count=1, flags=re.MULTILINE)
    citing = text("docs/citing.md")
    citing = re.sub(r"(?<=author  = \{\{).*(?=\}\})", author, citing)
    citing = re.sub(r"(?<=version = \{).*(?=\})", number, citing)
    citing = re.sub(r"(?<=url     = \{).*(?=\})", project["urls"]["Source"], citing)
    front = re.sub(r"(?<=\[GitHub\]\()[^)]*(?=\))", project["urls"]["Source"], text("docs/index.md"))
    if DATE.fullmatch(date):
        citing = re.sub(r"(?<=year    = \{).*(?=\})", date[:4], citing)
    pinned = re.sub(r"(?<=springgym-kernels==)[^;\"]+", number, text("pyproject.toml"))
    colab = text("docs/notebooks/first.ipynb")
    colab = re.sub(
        r"(?<=google\.com/github/)[^/]+/[^/]+", urlparse(project["urls"]["Source"]).path[1:], colab
    )
    colab = re.sub(r'(?<=git\+)https:[^\s"\\]+', project["urls"]["Source"], colab)
    return {
        "pyproject.toml": pinned,
        "CITATION.cff": citation,
        "docs/citing.md": citing,
        "docs/index.md": front,
        "docs/notebooks/first.ipynb": colab,
    }


def faults(tag: str) -> list[str]:
    """Return the reasons why a tag cannot be released; an empty list if it can be."""
    found = []
    number = version()
    if tag != f"v{number}":
        found.append(f"the tag is {tag}, but springgym/__init__.py has version {number}")
    if any(PLACEHOLDER in url for url in tomllib.loads(text("pyproject.toml"))["project"]["urls"].values()):
        found.append(f"pyproject.toml: the addresses still contain {PLACEHOLDER}; write the owner there")
    date, told = changes(number)
    if not DATE.fullmatch(date):
        found.append(f"CHANGELOG.md has no heading '## {number} (YYYY-MM-DD)'")
    elif not told.strip():
        found.append(f"CHANGELOG.md has no entries for {number}")
    found += [
        f"{path} has another version, date, author or address: run python release.py --write"
        for path, wanted in repeated().items()
        if text(path) != wanted
    ]
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tag", nargs="?", help="the tag to check, such as v0.2.0")
    parser.add_argument("--notes", type=Path, metavar="FILE", help="write its changelog to FILE")
    parser.add_argument(
        "--write",
        action="store_true",
        help="write the files that repeat version, date, authors or addresses",
    )
    options = parser.parse_args(arguments)
    if bool(options.tag) == options.write or (options.notes and not options.tag):
        parser.error("give either a tag or --write")
    if options.write:
        for path, wanted in repeated().items():
            (ROOT / path).write_text(wanted, encoding="utf-8")
        return 0
    found = faults(options.tag)
    for fault in found:
        print(f"release.py: {fault}", file=sys.stderr)
    if options.notes and not found:
        options.notes.write_text(with_addresses(changes(version())[1]), encoding="utf-8")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
