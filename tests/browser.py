"""A Chromium for the tests and the still pictures: found on this machine, else installed.

    python tests/browser.py            # print its path; install one where none is found
    python tests/browser.py NOTE       # write the reason to the file NOTE where none could be installed

The search order is the variable FLATQUAD_CHROMIUM, the commands on PATH, then Playwright's own download. A candidate
counts only if it starts: Playwright's download lacks system libraries on a bare machine, and Ubuntu's
`chromium-browser` may be an empty package.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

VARIABLE = "FLATQUAD_CHROMIUM"
COMMANDS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
APPLICATIONS = (
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)
"""Where macOS has them."""
SHELLS = ("chrome-headless-shell", "headless_shell", "chrome-headless-shell.exe")
"""Names of the executable in Playwright's download."""
PLAYWRIGHT = (sys.executable, "-m", "playwright")
MANAGERS = {
    "apt-get": (("apt-get", "update", "-q"), ("apt-get", "install", "-y", "-q", "chromium")),
    "dnf": (("dnf", "install", "-y", "-q", "chromium"),),
}
"""Package managers that need root, and what installs a Chromium with each."""
MISSING = (
    "No browser was found and none could be installed: install Chromium or Chrome, "
    f"or set {VARIABLE}=/path/to/chromium, and run again"
)
START_LIMIT, DOWNLOAD_LIMIT, PACKAGES_LIMIT = 30.0, 180.0, 600.0
"""Longest time for a browser to print its version, for a download, and for a package manager [s]."""


def find() -> str | None:
    """Return the path of a Chromium that starts, or None.

    Raises:
        ValueError: if FLATQUAD_CHROMIUM names one that does not start.
    """
    if chosen := os.environ.get(VARIABLE):
        if not starts(chosen):
            raise ValueError(f"{VARIABLE} is {chosen!r}, which does not start as a browser: correct or unset it")
        return chosen
    on_path = [path for path in map(shutil.which, COMMANDS) if path]
    for path in [*on_path, *APPLICATIONS]:
        if starts(path):
            return path
    own = downloaded()
    return own if own and starts(own) else None


def install() -> str | None:
    """Install a Chromium and return its path, or None: Playwright's download first, then the package manager."""
    for attempt in (download, add_libraries, add_package):
        attempt()
        if path := find():
            return path
    return None


def starts(path: str) -> bool:
    """Return whether an executable prints the version of a browser."""
    try:
        answer = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=START_LIMIT, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return answer.returncode == 0 and "chrom" in answer.stdout.lower()


def downloaded() -> str | None:
    """Return the executable that this version of Playwright has downloaded, or None."""
    command = [*PLAYWRIGHT, "install", "--dry-run", "--only-shell", "chromium"]
    try:
        plan = subprocess.run(command, capture_output=True, text=True, timeout=START_LIMIT, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        return None
    folders = [Path(line.partition(":")[2].strip()) for line in plan.splitlines() if "Install location" in line]
    files = [path for folder in folders for name in SHELLS for path in sorted(folder.glob(f"*/{name}"))]
    return str(files[0]) if files else None


def download() -> None:
    """Download Playwright's own Chromium."""
    attempt([*PLAYWRIGHT, "install", "--only-shell", "chromium"], DOWNLOAD_LIMIT)


def add_libraries() -> None:
    """Install the system libraries that a downloaded Chromium lacks; needs root."""
    root = privilege()
    if root is not None and downloaded():
        attempt([*root, *PLAYWRIGHT, "install-deps", "chromium"], PACKAGES_LIMIT)


def add_package() -> None:
    """Install Chromium by the system's package manager, where this user may."""
    root = privilege()
    for manager, commands in MANAGERS.items():
        if root is not None and shutil.which(manager):
            for command in commands:
                attempt([*root, "env", "DEBIAN_FRONTEND=noninteractive", *command], PACKAGES_LIMIT)
            return
    if shutil.which("brew"):
        attempt(["brew", "install", "--cask", "chromium"], PACKAGES_LIMIT)


def privilege() -> list[str] | None:
    """Return the words that run a command as root without asking for a password, or None."""
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        return []
    sudo = shutil.which("sudo")
    if sudo and subprocess.run([sudo, "-n", "true"], capture_output=True, check=False).returncode == 0:
        return [sudo, "-n"]
    return None


def attempt(command: Sequence[str], limit: float) -> bool:
    """Run a command for at most `limit` seconds, its output on standard error; return whether it succeeded."""
    print(f"no Chromium found, trying: {' '.join(command)}", file=sys.stderr, flush=True)
    try:
        # A session of its own: the limit must also end the downloader that Playwright starts.
        running = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=sys.stderr, start_new_session=True)
    except OSError as error:
        print(f"failed: {error}", file=sys.stderr)
        return False
    try:
        return running.wait(limit) == 0
    except subprocess.TimeoutExpired:
        print(f"failed: no answer in {limit:g} s", file=sys.stderr)
        if hasattr(os, "killpg"):
            os.killpg(running.pid, signal.SIGKILL)
        running.kill()
        running.wait()
        return False


def main(note: Path | None = None) -> int:
    """Print the path of a Chromium, installed if need be; return the exit status."""
    try:
        path, reason = find() or install(), MISSING
    except ValueError as error:
        path, reason = None, str(error)
    if note:
        note.write_text("" if path else reason, encoding="utf-8")
    print(path or reason, file=sys.stdout if path else sys.stderr)
    return 0 if path else 1


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:2])))
