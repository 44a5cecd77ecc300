"""Finding OpenFOAM: on the path, or behind WM_PROJECT_DIR; else one sentence with the command to run."""

import pytest

from fileio.errors import StageError
from pipeline.openfoam import environment as openfoam


@pytest.fixture(autouse=True)
def _fresh():
    openfoam.environment.cache_clear()
    openfoam.foam_version.cache_clear()
    openfoam.is_open_mpi.cache_clear()
    yield
    openfoam.environment.cache_clear()
    openfoam.foam_version.cache_clear()
    openfoam.is_open_mpi.cache_clear()


def fake(folder, banner, mpi="mpirun (Open MPI) 4.1.4"):
    """A pimpleFoam and an mpirun that print their versions as the real ones do, and an etc/bashrc beside their folder."""
    folder.mkdir(parents=True)
    (folder.parent / "etc").mkdir(exist_ok=True)
    (folder.parent / "etc" / "bashrc").touch()
    for name, said in (("pimpleFoam", banner), ("mpirun", mpi)):
        program = folder / name
        program.write_text(f"#!/bin/sh\necho '{said}'\n")
        program.chmod(0o755)


@pytest.mark.parametrize("environment", [{}, {"WM_PROJECT_DIR": ""}])
def test_missing_openfoam_names_the_command(monkeypatch, environment):
    monkeypatch.delenv("WM_PROJECT_DIR", raising=False)
    for name, value in ({"PATH": "/nowhere"} | environment).items():
        monkeypatch.setenv(name, value)
    with pytest.raises(StageError, match="sudo apt-get install openfoam"):
        openfoam.environment()


def test_wm_project_dir_alone_is_enough(monkeypatch, tmp_path):
    fake(tmp_path / "bin", "Using: OpenFOAM-v2312 (2312)")
    (tmp_path / "etc" / "bashrc").write_text(f"export PATH={tmp_path}/bin:$PATH\n")
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    monkeypatch.setattr(openfoam.shutil, "which", _which_without_system(openfoam.shutil.which))
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    assert openfoam.foam_version() == "v2312"


def test_wm_project_dir_goes_before_another_version_on_the_path(monkeypatch, tmp_path):
    fake(tmp_path / "old", "Using: OpenFOAM- (1912) - visit")
    fake(tmp_path / "new" / "bin", "Using: OpenFOAM-v2306 (2306) - visit")
    (tmp_path / "new" / "etc" / "bashrc").write_text(
        f"[ $# = 0 ] && export PATH={tmp_path}/new/bin:$PATH\n"
    )
    monkeypatch.setenv("PATH", f"{tmp_path}/old:/usr/bin:/bin")
    monkeypatch.delenv("FOAM_APPBIN", raising=False)
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path / "new"))
    assert openfoam.foam_version() == "v2306"


def test_a_version_whose_programs_are_not_built_takes_no_others(monkeypatch, tmp_path):
    fake(tmp_path / "old", "Using: OpenFOAM- (1912) - visit")
    (tmp_path / "new" / "etc").mkdir(parents=True)
    (tmp_path / "new" / "etc" / "bashrc").write_text("export FOAM_API=2306 FOAM_APPBIN=/nowhere\n")
    monkeypatch.setenv("PATH", f"{tmp_path}/old:/usr/bin:/bin")
    monkeypatch.delenv("FOAM_APPBIN", raising=False)
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path / "new"))
    with pytest.raises(StageError, match=r"that of OpenFOAM v2306 .* but pimpleFoam is of v1912"):
        openfoam.foam_version()


def test_the_folder_asked_for_is_taken_in_a_shell_with_another_version(monkeypatch, tmp_path):
    fake(tmp_path / "old", "Using: OpenFOAM-v1912 (1912) - visit www.openfoam.com")
    fake(tmp_path / "new" / "bin", "Using: OpenFOAM-v2306 (2306) - visit www.openfoam.com")
    (tmp_path / "new" / "etc" / "bashrc").write_text(
        f"export FOAM_API=2306 FOAM_APPBIN={tmp_path}/new/bin PATH={tmp_path}/new/bin:$PATH\n"
    )
    monkeypatch.setenv("PATH", f"{tmp_path}/old:/usr/bin:/bin")
    monkeypatch.setenv("FOAM_APPBIN", f"{tmp_path}/old")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path / "new"))
    assert openfoam.foam_version() == "v2306"


def test_a_folder_without_an_openfoam_is_told(monkeypatch, tmp_path):
    """openfoam.org's version 12 has no pimpleFoam."""
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    monkeypatch.setattr(openfoam.shutil, "which", _which_without_system(openfoam.shutil.which))
    (tmp_path / "v12" / "etc").mkdir(parents=True)
    (tmp_path / "v12" / "etc" / "bashrc").touch()
    for folder, said in (
        (tmp_path, "there is no etc/bashrc"),  # though a pimpleFoam may be on the path
        (tmp_path / "v12", "no pimpleFoam; openfoam.com v1912"),
    ):
        monkeypatch.setenv("WM_PROJECT_DIR", str(folder))
        with pytest.raises(StageError, match=said):
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
def test_banners_of_openfoam_com(monkeypatch, tmp_path, banner, version):
    fake(tmp_path / "bin", banner)
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    assert openfoam.foam_version() == version


def _which_without_system(which):
    """shutil.which that does not see an OpenFOAM installed system-wide."""

    def seen(name, path=None):
        program = which(name, path=path)
        return (
            None if program and program.startswith("/usr/bin") and name == "pimpleFoam" else program
        )

    return seen


@pytest.mark.parametrize(
    "banner, found",
    [
        ("Using: OpenFOAM- (1806) - visit", "OpenFOAM 1806"),
        ("Using: OpenFOAM-9 (see https://openfoam.org)", "OpenFOAM-9"),
        ("", "an unknown OpenFOAM"),
    ],
)
def test_an_old_or_foreign_version_is_refused(monkeypatch, tmp_path, banner, found):
    fake(tmp_path / "bin", banner)
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    with pytest.raises(StageError, match=f"^{found} found; openfoam.com v1912 or later is needed"):
        openfoam.foam_version()


def test_ranks_on_other_hosts_get_the_environment_they_need(monkeypatch, tmp_path):
    """mpirun by ssh forwards nothing by itself, and Debian's OpenFOAM does not start without WM_PROJECT_DIR."""
    fake(tmp_path / "bin", "Using: OpenFOAM-v1912")
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    command = openfoam.solver_command(8, tmp_path / "hosts.txt")
    forwarded = [command[k + 1] for k, word in enumerate(command) if word == "-x"]
    assert {"WM_PROJECT_DIR", "PATH", "OMP_NUM_THREADS"} <= set(forwarded)
    assert command[command.index("--hostfile") + 1] == str(tmp_path / "hosts.txt")
    assert command[-2:] == ["pimpleFoam", "-parallel"]
    assert "-x" not in openfoam.solver_command(8)


def test_mpich_gets_its_own_options(monkeypatch, tmp_path):
    fake(tmp_path / "bin", "Using: OpenFOAM-v1912", "HYDRA build details:")
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    assert openfoam.solver_command(2) == ["mpirun", "-np", "2", "pimpleFoam", "-parallel"]
    command = openfoam.solver_command(8, tmp_path / "hosts.txt")
    assert command[3:5] == ["-f", str(tmp_path / "hosts.txt")]
    assert {"WM_PROJECT_DIR", "PATH"} <= set(command[command.index("-genvlist") + 1].split(","))


def test_an_unknown_mpi_is_one_sentence(monkeypatch, tmp_path):
    fake(tmp_path / "bin", "Using: OpenFOAM-v1912", "some other launcher")
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    with pytest.raises(StageError, match="unknown MPI"):
        openfoam.solver_command(2)


def test_a_job_that_does_not_name_its_nodes_is_no_job_to_mpirun(monkeypatch, tmp_path):
    """Snakemake's jobs in Slurm keep some of its names, at which mpirun would look for the others and give up."""
    fake(tmp_path / "bin", "Using: OpenFOAM-v2312 (2312)")
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    monkeypatch.setenv("WM_PROJECT_DIR", str(tmp_path))
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    monkeypatch.delenv("SLURM_NODELIST", raising=False)
    assert not [name for name in openfoam.environment() if name.startswith("SLURM_")]
    assert "--oversubscribe" in openfoam.solver_command(2)
    openfoam.environment.cache_clear()
    monkeypatch.setenv("SLURM_NODELIST", "vm")
    monkeypatch.setenv("SLURM_TASKS_PER_NODE", "2")
    assert openfoam.environment()["SLURM_JOB_ID"] == "7"
    assert "--oversubscribe" not in openfoam.solver_command(2)
