"""Check a release, and write version, date, authors and addresses where files repeat them.

    python tools/release.py --write                                 # write them into these files
    python tools/release.py --write --address https://github.com/…  # with the address of the repository
    python tools/release.py v0.2.0                                  # check this tag, as the workflow does
    python tools/release.py v0.2.0 --notes FILE                     # and write its section of the changelog

The version comes from ``springgym/version.py``, and its date from its heading in ``CHANGELOG.md``. Authors
and addresses come from ``pyproject.toml``, which has no addresses until ``--address`` writes them. Once a
version has a date, README.md and docs/start.md say that springgym is on PyPI.
"""

from __future__ import annotations

import argparse
import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

ROOT = Path(__file__).resolve().parents[1]
ON_PYPI = {
    False: 'Once springgym is on PyPI, `pip install "springgym[agents]"` will replace the clone.',
    True: '`pip install "springgym[agents]"` installs the newest release from PyPI, without a clone.',
}
"""What README.md and docs/start.md say of PyPI, before and after the first release; a line of its own."""
COLAB = "docs/notebooks/first.ipynb"
HEADING = re.compile(r"^## (\S+) \((.+)\)$", re.MULTILINE)
"""Heading of a version in the changelog: its number, and its date or a word such as "unreleased"."""
DATE = re.compile(r"\d{4}-\d\d-\d\d")
REPOSITORY = re.compile(r"https://github\.com/[\w-]+/[\w.-]+")


def text(path: str) -> str:
    """Return the text of a file of the repository."""
    return (ROOT / path).read_text(encoding="utf-8")


def version() -> str:
    """Return the version of the package."""
    (found,) = re.findall(r'^__version__ = "(.+)"$', text("springgym/version.py"), re.MULTILINE)
    return str(found)


def changes(number: str) -> tuple[str, str]:
    """Return the date and the changelog of a version; both are empty if it has no heading."""
    log = text("CHANGELOG.md")
    for heading in HEADING.finditer(log):
        if heading[1] == number:
            told, *_ = re.split(r"^## ", log[heading.end() :], maxsplit=1, flags=re.MULTILINE)
            return heading[2], told.strip() + "\n"
    return "", ""


def project() -> dict[str, Any]:
    """Return the table ``project`` of ``pyproject.toml``."""
    return dict(tomllib.loads(text("pyproject.toml"))["project"])


def source() -> str:
    """Return the address of the repository; it is empty until it is known."""
    return str(project().get("urls", {}).get("Source", ""))


def with_urls(settings: str, address: str) -> str:
    """Return the text of ``pyproject.toml`` with the addresses of a repository on GitHub."""
    owner, name = urlparse(address).path.strip("/").split("/")
    repository = f"https://github.com/{owner}/{name}"
    site = f"https://{owner}.github.io/{name}"
    urls = {"Homepage": site, "Documentation": site, "Source": repository}
    urls |= {"Issues": f"{repository}/issues", "Changelog": f"{repository}/blob/main/CHANGELOG.md"}
    table = "".join(f'{key} = "{url}"\n' for key, url in urls.items())
    without = re.sub(r"^\[project\.urls\]\n(.+\n)*\n", "", settings, flags=re.MULTILINE)
    return without.replace("[project.optional", f"[project.urls]\n{table}\n[project.optional", 1)


def with_addresses(page: str) -> str:
    """Return a page with absolute addresses of links and pictures, in the tagged version, once known."""
    if not (address := source()):
        return page

    def whole(found: re.Match[str]) -> str:
        kind = "raw" if found[1] == 'src="' else "blob"
        return f"{found[1]}{address}/{kind}/v{version()}/{found[2]}"

    return re.sub(r'(\]\(|href="|src=")(?![a-z]+:|#)([^)"\s]+)', whole, page)


def about_pypi(path: str) -> str:
    """Return a page with the sentence about PyPI that is true.

    Raises
    ------
    ValueError
        If the page has no such sentence.
    """
    page = text(path)
    said = [sentence for sentence in ON_PYPI.values() if f"\n{sentence}\n" in page]
    if len(said) != 1:
        raise ValueError(f"{path} must say once, in a line of its own: {' or: '.join(ON_PYPI.values())}")
    released = any(DATE.fullmatch(date) for _, date in HEADING.findall(text("CHANGELOG.md")))
    return page.replace(said[0], ON_PYPI[released])


def repeated() -> dict[str, str]:
    """Return the correct text of the files that repeat version, date, authors or address."""
    (author,) = (author["name"] for author in project()["authors"])
    number = version()
    address = source()
    date, _ = changes(number)
    dated = bool(DATE.fullmatch(date))
    citation = re.sub(r"(?m)^(date-released|repository-code|url): .*\n", "", text("CITATION.cff"))
    known = f'date-released: "{date}"\n' if dated else ""
    known += f"repository-code: {address}\nurl: {project()['urls']['Homepage']}\n" if address else ""
    citation = re.sub(r"^version: .*\n", f"version: {number}\n{known}", citation, flags=re.MULTILINE)
    citation = re.sub(r"^  - name: .*$", f"  - name: {author}", citation, count=1, flags=re.MULTILINE)
    citing = re.sub(r"^  url     = .*\n", "", text("docs/citing.md"), flags=re.MULTILINE)
    citing = re.sub(r"(?<=author  = \{\{).*(?=\}\})", author, citing)
    citing = re.sub(r"(?<=version = \{).*(?=\})", number, citing)
    citing = re.sub(r"(?<=year    = \{).*(?=\})", date[:4], citing) if dated else citing
    url = f"  url     = {{{address}}},\n" if address else ""
    citing = re.sub(r"^(  year .*\n)", rf"\1{url}", citing, flags=re.MULTILINE)
    colab = re.sub(r'^ *"\[Open this .*\n *"\\n",\n', "", text(COLAB), flags=re.MULTILINE)
    if address:
        place = f"https://colab.research.google.com/github{urlparse(address).path}/blob/main/{COLAB}"
        link = f'    "[Open this notebook in Colab]({place})\\n",\n    "\\n",\n'
        heading = '    "# First steps\\n",\n    "\\n",\n'
        colab = colab.replace(heading, heading + link)
    return {
        "pyproject.toml": re.sub(r"(?<=springgym-kernels==)[^;\"]+", number, text("pyproject.toml")),
        "CITATION.cff": citation,
        "docs/citing.md": citing,
        COLAB: colab,
        "README.md": about_pypi("README.md"),
        "docs/start.md": about_pypi("docs/start.md"),
    }


def faults(tag: str) -> list[str]:
    """Return the reasons why a tag cannot be released; an empty list if it can be."""
    found = []
    number = version()
    if tag != f"v{number}":
        found.append(f"the tag is {tag}, but springgym/version.py has version {number}")
    if not source():
        found.append("pyproject.toml has no addresses: run python tools/release.py --write --address URL")
    date, told = changes(number)
    if not DATE.fullmatch(date):
        found.append(f"CHANGELOG.md has no heading '## {number} (YYYY-MM-DD)'")
    elif not told.strip():
        found.append(f"CHANGELOG.md has no entries for {number}")
    found += [
        f"{path} has another version, date, author or address: run python tools/release.py --write"
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
        "--write", action="store_true", help="write the files that repeat version, date, authors or addresses"
    )
    parser.add_argument(
        "--address", metavar="URL", help="with --write: address of the repository, https://github.com/…/…"
    )
    options = parser.parse_args(arguments)
    if bool(options.tag) == options.write or (options.notes and not options.tag):
        parser.error("give either a tag or --write")
    if options.address and (options.tag or not REPOSITORY.fullmatch(options.address)):
        parser.error("--address belongs to --write, and has the form https://github.com/OWNER/NAME")
    if options.address:
        settings = with_urls(text("pyproject.toml"), options.address)
        (ROOT / "pyproject.toml").write_text(settings, encoding="utf-8")
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
