"""Define one-word chores such as ``nox -s style``; ``nox -l`` lists them.

They use the interpreter that runs nox, and the packages installed for it. The workflows in
.github/workflows run the same chores. Arguments after ``--`` go to the command, as in
``nox -s tests -- tests/test_lanes.py -n 0``.
"""

import shutil
import sys

import nox

nox.options.default_venv_backend = "none"
nox.options.sessions = ["style", "types", "tests"]


def pytest(session: nox.Session, *arguments: str) -> None:
    """Run tests with the interpreter that runs nox."""
    session.run(sys.executable, "-m", "pytest", *arguments, *session.posargs)


@nox.session
def style(session: nox.Session) -> None:
    """Check the style and format of code, and the spelling; `nox -s style -- --fix` corrects what it can."""
    fix = "--fix" in session.posargs
    if fix:
        session.run(sys.executable, "-m", "ruff", "check", "--fix-only", ".")
    session.run(sys.executable, "-m", "ruff", "format", *([] if fix else ["--check"]), ".")
    session.run(sys.executable, "-m", "ruff", "check", ".")
    session.run("codespell", *(["--write-changes"] if fix else []), external=True)


@nox.session
def types(session: nox.Session) -> None:
    """Check types."""
    session.run(sys.executable, "-m", "mypy", *session.posargs)


@nox.session
def tests(session: nox.Session) -> None:
    """Run the tests, on all cores."""
    pytest(session)


@nox.session
def slow(session: nox.Session) -> None:
    """Run the tests that take long."""
    pytest(session, "-m", "slow")


@nox.session
def browser(session: nox.Session) -> None:
    """Run the tests of the view in Chromium."""
    pytest(session, "-n", "0", "-m", "browser")


@nox.session
def site(session: nox.Session) -> None:
    """Build the documentation into docs/_build/html."""
    session.run(sys.executable, "docs/build.py", *session.posargs)


@nox.session
def package(session: nox.Session) -> None:
    """Build sdist and wheel into dist/, and check their metadata."""
    for folder in ("build", "dist"):
        shutil.rmtree(folder, ignore_errors=True)
    session.run(sys.executable, "-m", "build", *session.posargs)
    session.run(sys.executable, "-m", "twine", "check", "--strict", "dist/*")


@nox.session
def kernels(session: nox.Session) -> None:
    """Build the wheel of compiled code into dist/: `nox -s kernels -- SpringTop-v0` of one environment."""
    session.run(sys.executable, "tools/kernels.py", *session.posargs)


@nox.session
def release(session: nox.Session) -> None:
    """Check whether a tag can be released: `nox -s release -- v0.2.0`."""
    session.run(sys.executable, "tools/release.py", *session.posargs)


@nox.session
def rehearse(session: nox.Session) -> None:
    """Rehearse the release of a tag in clean environments: `nox -s rehearse -- v0.2.0`."""
    session.run(sys.executable, "tools/rehearse.py", *session.posargs)
