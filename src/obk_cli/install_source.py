"""Build the `pip install` command that installs obk from the same source as the running copy.

Obelisk may be installed from a clone, a git URL, a wheel or an index. A command that names any
source other than the one in use fails, or installs something else. pip records the source in
`direct_url.json` (PEP 610).
"""

import importlib.metadata
import json
import shlex
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit, urlunsplit

__all__ = ["InstallSource", "install_command", "read_install_source"]

TOOL: Final = "obelisk-cli"
MESSAGES: Final = "obelisk-interfaces"
"""The distribution with the compiled messages, which the `ros` extra needs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InstallSource:
    """Where an installed obk came from. If all fields are empty, it came from an index."""

    folder: Path | None = None
    """A clone or an unpacked source distribution."""
    is_editable: bool = False
    git: str = ""
    """`git+URL@COMMIT`."""
    archive: str = ""
    """URL of a wheel or source distribution; for a local file `file:///...`."""
    messages: str = ""
    """URL of the archive with the compiled messages; empty if they have no archive of their own."""

    def pip_install(self, *extras: str) -> str:
        """Return a command for a POSIX shell that installs obk with these extras."""
        options = "[" + ",".join(extras) + "]" if extras else ""
        return shlex.join(("pip", "install", *self._requirements(options, "ros" in extras)))

    def _requirements(self, options: str, has_ros: bool) -> Sequence[str]:
        if self.git:
            messages = f"{MESSAGES} @ {self.git}#subdirectory=interfaces"
            return (f"{TOOL}{options} @ {self.git}", *([messages] if has_ros else ()))
        if self.folder is not None:
            editable = ["--editable"] if self.is_editable else []
            tool = f"{self.folder}{options}"
            return (*editable, tool, *([f"{self.folder / 'interfaces'}"] if has_ros else ()))
        if self.archive:
            tool = f"{TOOL}{options} @ {self.archive}"
            if has_ros and self.messages:
                return (tool, f"{MESSAGES} @ {self.messages}")
            local = _local_path(self.archive)
            # The archive's folder may also contain the messages; to build them, pip must find the
            # tool there.
            find = ["--find-links", str(local.parent)] if local and has_ros else []
            return (*find, tool)
        return (f"{TOOL}{options}",)

    def for_other_machines(self) -> "InstallSource":
        """Return the git URL if this is a clone with a published commit, otherwise this source."""
        if self.folder is None:
            return self
        unchanged = replace(self, is_editable=False)
        commit = _git(self.folder, "rev-parse", "HEAD")
        branches = _git(self.folder, "branch", "--remotes", "--contains", "HEAD")
        url = _remote_url(_git(self.folder, "config", "--get", "remote.origin.url") or "")
        # For a folder inside another repository, git reports the commit of that repository.
        is_clone = _git(self.folder, "rev-parse", "--show-cdup") == "" and commit
        if not (is_clone and branches and url):
            return unchanged
        return InstallSource(git=f"git+{url}@{commit}")

    @property
    def is_local(self) -> bool:
        """Whether the source exists only on this machine."""
        places = (self.archive, self.messages, self.git.removeprefix("git+"))
        return self.folder is not None or any(place.startswith("file:") for place in places)


def install_command(*extras: str) -> str:
    """Return the command that adds these extras to the running obk, for a POSIX shell."""
    return read_install_source().pip_install(*extras)


def read_install_source() -> InstallSource:
    """Return where the running obk was installed from."""
    source = _recorded(TOOL)
    return replace(source, messages=_recorded(MESSAGES).archive) if source.archive else source


def _recorded(distribution: str) -> InstallSource:
    try:
        text = importlib.metadata.distribution(distribution).read_text("direct_url.json")
    except importlib.metadata.PackageNotFoundError:
        text = None
    return parse_direct_url(json.loads(text)) if text else InstallSource()


def parse_direct_url(record: dict[str, Any]) -> InstallSource:
    """Return the source that a `direct_url.json` describes (PEP 610)."""
    url = str(record["url"])
    if vcs := record.get("vcs_info"):
        return InstallSource(git=f"{vcs['vcs']}+{url}@{vcs['commit_id']}")
    if "dir_info" in record:
        is_editable = bool(record["dir_info"].get("editable"))
        return InstallSource(folder=_local_path(url), is_editable=is_editable)
    return InstallSource(archive=url)


def _local_path(url: str) -> Path | None:
    parts = urlsplit(url)
    return Path(unquote(parts.path)) if parts.scheme == "file" else None


def _git(folder: Path, *arguments: str) -> str | None:
    """Return git's output; None without git or outside a repository."""
    command = ("git", "-C", str(folder), *arguments)
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _remote_url(remote: str) -> str:
    """Return a remote's URL without a password or token; empty for a local folder."""
    if "://" not in remote:
        host, colon, path = remote.partition(":")
        is_scp = colon and "/" not in host
        return f"ssh://{host}/{path}" if is_scp else ""
    parts = urlsplit(remote)
    if parts.scheme == "file":
        return ""
    if parts.scheme == "ssh":
        return remote
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))
