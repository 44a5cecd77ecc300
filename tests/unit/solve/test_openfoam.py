"""Finding OpenFOAM on the path or behind WM_PROJECT_DIR; else one sentence with a remedy."""

import pytest

from pipeline.openfoam import environment as openfoam
from piv.files.errors import StageError

CACHED = (openfoam.environment, openfoam.foam_version, openfoam.is_open_mpi)
V1912, V2306 = "Using: OpenFOAM- (1912) - visit", "Using: OpenFOAM-v2306 (2306) - visit"


@pytest.fixture(autouse=True)
def _fresh(monkeypatch):
    for name in ("FOAM_APPBIN", "WM_PROJECT_DIR", "SLURM_NODELIST"):
        monkeypatch.delenv(name, raising=False)
    for function in CACHED:
        function.cache_clear()
    yield
    for function in CACHED:
        function.cache_clear()


def fake(folder, banner=V1912, mpi="mpirun (Open MPI) 4.1.4", bashrc=""):
    """An installation in `folder` whose pimpleFoam and mpirun print their versions."""
    for name, text in (("pimpleFoam", banner), ("mpirun", mpi)):
        program = folder / "bin" / name
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text(f"#!/bin/sh\necho '{text}'\n")
        program.chmod(0o755)
    (folder / "etc").mkdir()
    (folder / "etc" / "bashrc").write_text(bashrc)
    return folder / "bin"


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """A function that makes an installation the one in use."""

    def install(*arguments):
        programs = fake(tmp_path / "foam", *arguments)
        monkeypatch.setenv("PATH", f"{programs}:/usr/bin:/bin")
        monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path / "foam"))

    return install


@pytest.fixture
def without_system(monkeypatch):
    """No OpenFOAM of the system."""
    which = openfoam.shutil.which

    def seen(name, path=None):
        program = which(name, path=path)
        system = name == "pimpleFoam" and program and program.startswith("/usr/bin")
        return None if system else program

    monkeypatch.setattr(openfoam.shutil, "which", seen)
    monkeypatch.setenv("PATH", "/usr/bin:/bin")


@pytest.mark.parametrize("folder", [None, ""])
def test_missing_openfoam_names_the_command(monkeypatch, folder):
    monkeypatch.setenv("PATH", "/nowhere")
    if folder is not None:
        monkeypatch.setenv("WM_PROJECT_DIR", folder)
    with pytest.raises(StageError, match="sudo apt-get install openfoam"):
        openfoam.environment()


@pytest.mark.usefixtures("without_system")
def test_wm_project_dir_alone_is_enough(monkeypatch, tmp_path):
    bashrc = f"export PATH={tmp_path}/foam/bin:$PATH\n"
    fake(tmp_path / "foam", "Using: OpenFOAM-v2312 (2312)", bashrc=bashrc)
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path / "foam"))
    assert openfoam.foam_version() == "v2312"


@pytest.mark.parametrize("sourced", [False, True])
def test_wm_project_dir_goes_before_another_version(monkeypatch, tmp_path, sourced):
    """Another version is on the path, or its environment is that of the shell."""
    old, new = fake(tmp_path / "old"), tmp_path / "new" / "bin"
    bashrc = f"[ $# = 0 ] && export FOAM_API=2306 FOAM_APPBIN={new} PATH={new}:$PATH\n"
    fake(tmp_path / "new", V2306, bashrc=bashrc)
    monkeypatch.setenv("PATH", f"{old}:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path / "new"))
    if sourced:
        monkeypatch.setenv("FOAM_APPBIN", str(old))
    assert openfoam.foam_version() == "v2306"


def test_a_version_without_programs_does_not_use_those_of_another(monkeypatch, tmp_path):
    old = fake(tmp_path / "old")
    (tmp_path / "new" / "etc").mkdir(parents=True)
    (tmp_path / "new" / "etc" / "bashrc").write_text("export FOAM_API=2306 FOAM_APPBIN=/nowhere\n")
    monkeypatch.setenv("PATH", f"{old}:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path / "new"))
    with pytest.raises(StageError, match=r"that of OpenFOAM v2306 .* but pimpleFoam is of v1912"):
        openfoam.foam_version()


@pytest.mark.usefixtures("without_system")
@pytest.mark.parametrize(  # openfoam.org's version 12 has the file
    "bashrc, words",
    [(False, "there is no etc/bashrc"), (True, "no pimpleFoam; openfoam.com v1912")],
)
def test_a_folder_without_an_openfoam_is_refused(monkeypatch, tmp_path, bashrc, words):
    if bashrc:
        (tmp_path / "etc").mkdir()
        (tmp_path / "etc" / "bashrc").touch()
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    with pytest.raises(StageError, match=words):
        openfoam.environment()


@pytest.mark.parametrize(
    "banner, version",
    [
        ("Using: OpenFOAM- (1912) - visit www.openfoam.com", "v1912"),  # Debian
        ("Using: OpenFOAM-v2306 (2306) - visit www.openfoam.com", "v2306"),
        ("Using: OpenFOAM-2512 (2512) - visit www.openfoam.com", "v2512"),
        ("Using: OpenFOAM-com (2506) - visit www.openfoam.com", "v2506"),  # a development version
    ],
)
def test_banners_of_openfoam_com(installed, banner, version):
    installed(banner)
    assert openfoam.foam_version() == version


@pytest.mark.parametrize(
    "banner, found",
    [
        ("Using: OpenFOAM- (1806) - visit", "OpenFOAM 1806"),
        ("Using: OpenFOAM-9 (see https://openfoam.org)", "OpenFOAM-9"),
        ("", "an unknown OpenFOAM"),
    ],
)
def test_an_old_or_foreign_version_is_refused(installed, banner, found):
    installed(banner)
    with pytest.raises(StageError, match=f"^{found} found; openfoam.com v1912 or later is needed"):
        openfoam.foam_version()


def test_ranks_on_other_hosts_get_the_environment_they_need(installed, tmp_path):
    """mpirun by ssh forwards nothing, and Debian's OpenFOAM needs WM_PROJECT_DIR."""
    installed()
    command = openfoam.solver_command(tmp_path, 8, "hosts.txt")
    forwarded = [command[k + 1] for k, word in enumerate(command) if word == "-x"]
    assert {"WM_PROJECT_DIR", "PATH", "OMP_NUM_THREADS", "MALLOC_MMAP_MAX_"} <= set(forwarded)
    assert command[command.index("--hostfile") + 1] == "hosts.txt"
    assert command[-2:] == ["pimpleFoam", "-parallel"]
    assert "-x" not in openfoam.solver_command(tmp_path, 8)


def test_mpich_gets_its_own_options(installed, tmp_path):
    installed(V1912, "HYDRA build details:")
    named = ["env", f"PWD={tmp_path}", "pimpleFoam", "-parallel"]
    assert openfoam.solver_command(tmp_path, 2) == ["mpirun", "-np", "2", *named]
    command = openfoam.solver_command(tmp_path, 8, "hosts.txt")
    assert command[3:5] == ["-f", "hosts.txt"]
    assert {"WM_PROJECT_DIR", "PATH"} <= set(command[command.index("-genvlist") + 1].split(","))


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("name", ["a b", "o'brien", 'q"q', "a\nb"])
def test_a_folder_that_openfoam_cannot_name_is_its_working_folder(tmp_path, name):
    """It drops spaces and quotes of PWD, then finds no case; so it gets a name without them."""
    case = tmp_path / name
    case.mkdir()
    (case / "here").touch()
    openfoam.run_tool(["sh", "-c", 'echo "$PWD"; ls "$PWD/"'], case)
    assert (case / "log.sh").read_text().split() == ["/proc/self/cwd", "here", "log.sh"]


def test_an_unknown_mpi_is_one_sentence(installed, tmp_path):
    installed(V1912, "some other launcher")
    with pytest.raises(StageError, match="unknown MPI"):
        openfoam.solver_command(tmp_path, 2)


def test_mpirun_sees_no_slurm_job_without_its_nodes(monkeypatch, installed, tmp_path):
    """Snakemake's jobs keep some of Slurm's variables; mpirun would fail without the others."""
    installed()
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    assert not [name for name in openfoam.environment() if name.startswith("SLURM_")]
    assert "--oversubscribe" in openfoam.solver_command(tmp_path, 2)
    openfoam.environment.cache_clear()
    monkeypatch.setenv("SLURM_NODELIST", "vm")
    monkeypatch.setenv("SLURM_TASKS_PER_NODE", "2")
    assert openfoam.environment()["SLURM_JOB_ID"] == "7"
    assert "--oversubscribe" not in openfoam.solver_command(tmp_path, 2)
