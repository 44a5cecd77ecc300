"""Finding OpenFOAM and running its programs."""

import contextlib
import ctypes
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from piv.files.atomic import check_room, name_in_errors
from piv.files.errors import StageError

_INSTALL = "apt-get install openfoam"
_NEEDED = (
    "openfoam.com v1912 or later is needed, openfoam.org's will not do (docs/openfoam_versions.md)"
)
# What OpenFOAM's programs need of their environment.
_FORWARDED = ("WM_", "FOAM_", "PATH", "LD_LIBRARY_PATH", "OMP_NUM_THREADS", "MALLOC_")
# glibc keeps the memory of fields, which every step takes and frees
_MEMORY = {"MMAP_MAX_": "0", "TRIM_THRESHOLD_": "4294967296", "TOP_PAD_": "67108864"}
_PACKAGED = Path("/usr/share/openfoam")  # Debian's package sets no WM_PROJECT_DIR
_HERE = "/proc/self/cwd"


@cache
def environment() -> dict[str, str]:
    """Environment in which OpenFOAM's programs run. Raises StageError where there is none."""
    env = dict(os.environ)
    if not env.get("WM_PROJECT_DIR"):  # empty is as good as unset
        env.pop("WM_PROJECT_DIR", None)
    chosen = Path(env.get("WM_PROJECT_DIR", _PACKAGED))
    if chosen != _PACKAGED:
        if not (chosen / "etc" / "bashrc").is_file():
            raise StageError(
                f"WM_PROJECT_DIR = {chosen}: there is no etc/bashrc; give the folder of an"
                " OpenFOAM, or unset it"
            )
        # not sourced, or another version is: the pimpleFoam on the path is that one's
        programs = Path(env.get("FOAM_APPBIN", "/"))
        if not programs.resolve().is_relative_to(chosen.resolve()):
            env = _sourced(chosen / "etc" / "bashrc")
        if shutil.which("pimpleFoam", path=env.get("PATH")) is None:
            raise StageError(f"WM_PROJECT_DIR = {chosen}: it has no pimpleFoam; {_NEEDED}")
    if shutil.which("pimpleFoam", path=env.get("PATH")) is None:
        raise StageError(
            f"OpenFOAM is not installed (no pimpleFoam on the path); run: sudo {_INSTALL}"
        )
    if "WM_PROJECT_DIR" not in env:
        if not (_PACKAGED / "etc").is_dir():
            raise StageError("WM_PROJECT_DIR is not set; source OpenFOAM's etc/bashrc first")
        env["WM_PROJECT_DIR"] = str(_PACKAGED)
    # one more busy process would stall spinning ranks
    env.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
    env["OMP_NUM_THREADS"] = "1"
    for name, value in _MEMORY.items():
        env.setdefault(f"MALLOC_{name}", value)
    whole = _in_whole_job(env)
    return {k: v for k, v in env.items() if whole or not k.startswith("SLURM_")}


def _in_whole_job(env: Mapping[str, str]) -> bool:
    """Whether this is a Slurm job that lists its nodes for mpirun, unlike Snakemake's jobs."""
    return "SLURM_JOB_ID" in env and {"SLURM_NODELIST", "SLURM_TASKS_PER_NODE"} <= env.keys()


def _sourced(bashrc: Path) -> dict[str, str]:
    """The environment after `source <bashrc>`."""
    # OpenFOAM's bashrc sources files among the shell's arguments: its own name must not be there
    script = 'f=$1; shift; source "$f" >/dev/null 2>&1; env -0'
    command = ["bash", "-c", script, "bash", str(bashrc)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return dict(entry.split("=", 1) for entry in text.split("\0") if "=" in entry)


def _program(folder: Path, *words: str) -> list[str]:
    """The command of one of OpenFOAM's programs that is started in `folder`.

    OpenFOAM trusts PWD as the name of its folder, and drops spaces and quotes of it. Where the
    path has any, PWD is the system's link to the folder in which a process is.
    """
    path = str(folder.resolve())
    odd = any(c.isspace() or c in "\"'" for c in path)
    return ["env", f"PWD={_HERE if odd else path}", *words]


def die_with_parent() -> None:
    """For a child, before it starts: end with the parent, however that ends (Linux only)."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


@cache
def foam_version() -> str:
    """OpenFOAM's version, as v1912; StageError for an older one or another than openfoam.com's."""
    done = subprocess.run(
        ["pimpleFoam", "-help"], env=environment(), capture_output=True, text=True
    )
    # as "OpenFOAM-v2306 (2306)"; the text before the brackets differs between versions
    match = re.search(r"OpenFOAM-\S*\s*\((\d{4})\)|OpenFOAM-v(\d{4})\b", done.stdout)
    number = (match[1] or match[2]) if match else None
    if number is None or int(number) < 1912:
        other = re.search(r"OpenFOAM-\S+", done.stdout + done.stderr)
        name = f"OpenFOAM {number}" if number else other[0] if other else "an unknown OpenFOAM"
        raise StageError(f"{name} found; {_NEEDED}")
    # of an environment whose own programs are not built, another's would be taken
    api = environment().get("FOAM_API") or number
    if api != number:
        folder = environment()["WM_PROJECT_DIR"]
        raise StageError(
            f"the environment is that of OpenFOAM v{api} ({folder}), but pimpleFoam is of"
            f" v{number}; build it there too"
        )
    return f"v{number}"


def check_openfoam(ranks: int) -> None:
    """StageError where OpenFOAM, or MPI for `ranks` > 1, is missing or of another kind."""
    foam_version()
    if ranks > 1:
        is_open_mpi()


def run_tool(arguments: list[str], case: Path) -> None:
    """Run one of OpenFOAM's utilities in `case`, its output in a log of its name.

    StageError with its last lines on failure; OSError where the disk is full.
    """
    path = case / f"log.{arguments[0]}"
    command = _program(case, *arguments)
    with name_in_errors(path), open(path, "w", encoding="utf-8") as output:
        done = subprocess.run(
            command, cwd=case, env=environment(), stdout=output, stderr=subprocess.STDOUT
        )
    if done.returncode != 0:
        check_room(case)
        raise StageError(f"{arguments[0]} failed in {case}; its last lines:\n{last_lines(path)}")


def last_lines(path: Path) -> str:
    """The end of a log."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []
    return "\n".join(lines[-25:])


def solver_command(folder: Path, ranks: int, hosts: Path | None = None) -> list[str]:
    """pimpleFoam in `folder`, by MPI where `ranks` > 1; in a Slurm job on the cores of the job."""
    if ranks == 1:
        return _program(folder, "pimpleFoam")
    # the environment of a login by ssh on other hosts lacks OpenFOAM's variables
    names = sorted(name for name in environment() if name.startswith(_FORWARDED)) if hosts else []
    if is_open_mpi():
        flags = ["--allow-run-as-root"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        if hosts or not _in_whole_job(os.environ):
            # a shared machine: ranks yield, move, and may be more than its cores
            flags += ["--mca", "mpi_yield_when_idle", "1", "--bind-to", "none", "--oversubscribe"]
        flags += ["--hostfile", str(hosts)] if hosts else []
        flags += [word for name in names for word in ("-x", name)]
    else:  # Hydra binds no rank and allows more ranks than cores by itself
        flags = ["-f", str(hosts), "-genvlist", ",".join(names)] if hosts else []
    return ["mpirun", "-np", str(ranks), *flags, *_program(folder, "pimpleFoam", "-parallel")]


@cache
def is_open_mpi() -> bool:
    """Whether mpirun is Open MPI's, not Hydra (MPICH, Intel MPI); StageError for neither."""
    try:
        shown = subprocess.run(
            ["mpirun", "--version"], env=environment(), capture_output=True, text=True
        )
    except FileNotFoundError:
        raise StageError(
            "mpirun is not on the path, so OpenFOAM runs on one rank only; install Open MPI or"
            " MPICH, or give NP=1"
        ) from None
    text = shown.stdout + shown.stderr
    if "Open MPI" in text or "OpenRTE" in text or "prte" in text.lower():
        return True
    if any(name in text for name in ("HYDRA", "Hydra", "MPICH", "Intel")):
        return False
    raise StageError(
        f"mpirun is of an unknown MPI ({text.strip()[:60]!r}); use Open MPI or MPICH, or give NP=1"
    )
