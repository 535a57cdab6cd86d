"""What a release must say alike everywhere, and what must not be released.

    python release.py --write              # version, date, authors and address, where other files repeat them
    python release.py v0.2.0               # whether this tag can be released; the workflow asks
    python release.py v0.2.0 --notes FILE  # and writes what the changelog says of it

The version is that of ``springgym/__init__.py``, its date that of its heading in ``CHANGELOG.md``. Authors
and addresses are those of ``pyproject.toml``.
"""

from __future__ import annotations

import argparse
import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent
PLACEHOLDER = "OWNER"
"""Stands in the addresses of ``pyproject.toml`` as long as nobody has said where the project lives."""
HEADING = re.compile(r"^## (\S+) \((.+)\)$", re.MULTILINE)
"""Of a version in the changelog: its number, and its date or a word that says that it has none."""
DATE = re.compile(r"\d{4}-\d\d-\d\d")


def text(path: str) -> str:
    """Return the text of a file of the repository."""
    return (ROOT / path).read_text(encoding="utf-8")


def version() -> str:
    """Return the version of the package."""
    (found,) = re.findall(r'^__version__ = "(.+)"$', text("springgym/__init__.py"), re.MULTILINE)
    return str(found)


def changes(number: str) -> tuple[str, str]:
    """Return the date of a version, and what the changelog says of it: both empty if it has no heading."""
    log = text("CHANGELOG.md")
    for heading in HEADING.finditer(log):
        if heading[1] == number:
            told, *_ = re.split(r"^## ", log[heading.end() :], maxsplit=1, flags=re.MULTILINE)
            return heading[2], told.strip() + "\n"
    return "", ""


def with_addresses(page: str) -> str:
    """Return a page of the repository with whole addresses: links and pictures of the tagged version."""
    source = tomllib.loads(text("pyproject.toml"))["project"]["urls"]["Source"]

    def whole(found: re.Match[str]) -> str:
        kind = "raw" if found[1] == 'src="' else "blob"
        return f"{found[1]}{source}/{kind}/v{version()}/{found[2]}"

    return re.sub(r'(\]\(|href="|src=")(?![a-z]+:|#)([^)"\s]+)', whole, page)


def repeated() -> dict[str, str]:
    """Return the files that repeat version, date, authors or address, as they have to be."""
    project = tomllib.loads(text("pyproject.toml"))["project"]
    (author,) = (author["name"] for author in project["authors"])
    number = version()
    date, _ = changes(number)
    citation = text("CITATION.cff")
    for key, value in {
        "  - name": author,
        "version": number,
        "date-released": f'"{date}"' if DATE.fullmatch(date) else None,
        "repository-code": project["urls"]["Source"],
        "url": project["urls"]["Homepage"],
    }.items():
        if value is not None:
            citation = re.sub(rf"^{key}: .*$", f"{key}: {value}", citation, count=1, flags=re.MULTILINE)
    citing = text("docs/citing.md")
    citing = re.sub(r"(?<=author  = \{\{).*(?=\}\})", author, citing)
    citing = re.sub(r"(?<=version = \{).*(?=\})", number, citing)
    citing = re.sub(r"(?<=url     = \{).*(?=\})", project["urls"]["Source"], citing)
    front = re.sub(r"(?<=\[GitHub\]\()[^)]*(?=\))", project["urls"]["Source"], text("docs/index.md"))
    if DATE.fullmatch(date):
        citing = re.sub(r"(?<=year    = \{).*(?=\})", date[:4], citing)
    return {"CITATION.cff": citation, "docs/citing.md": citing, "docs/index.md": front}


def faults(tag: str) -> list[str]:
    """Return why a tag cannot be released; an empty list if it can."""
    found = []
    number = version()
    if tag != f"v{number}":
        found.append(f"the tag is {tag}, but springgym/__init__.py has version {number}")
    if PLACEHOLDER in text("pyproject.toml"):
        found.append(f"pyproject.toml: the addresses still hold {PLACEHOLDER}; say where the project lives")
    date, told = changes(number)
    if not DATE.fullmatch(date):
        found.append(f"CHANGELOG.md: no heading '## {number} (YYYY-MM-DD)'")
    elif not told.strip():
        found.append(f"CHANGELOG.md says nothing of {number}")
    found += [
        f"{path} repeats something else: python release.py --write"
        for path, wanted in repeated().items()
        if text(path) != wanted
    ]
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Do what the command line asks for, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tag", nargs="?", help="such as v0.2.0")
    parser.add_argument("--notes", type=Path, metavar="FILE", help="write what is new in it here")
    parser.add_argument("--write", action="store_true", help="write what other files repeat")
    options = parser.parse_args(arguments)
    if bool(options.tag) == options.write or (options.notes and not options.tag):
        parser.error("give a tag, or --write")
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
