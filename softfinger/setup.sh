#!/bin/sh
# What `make setup` does: a Python environment from the lock file, OpenFOAM, and the libraries that gmsh and VTK load.
# Uses what is there; installs with apt-get only where it may (root, or sudo without a password); else says what to run.
set -eu
cd "$(dirname "$0")/.."

trap 'echo "setup: interrupted; run make setup again: it goes on" >&2; exit 130' INT

as_root() {
    if [ "$(id -u)" = 0 ]; then DEBIAN_FRONTEND=noninteractive "$@"
    elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then sudo -n env DEBIAN_FRONTEND=noninteractive "$@"
    else return 1
    fi
}

install() { # packages…: by apt-get, or one sentence with the command
    if command -v apt-get >/dev/null; then
        # a list that is old or missing is renewed once, and only where the package is not found in it
        as_root apt-get install -y -qq --no-install-recommends "$@" >.setup.log 2>&1 && return 0
        as_root apt-get update -qq >.setup.log 2>&1 \
            && as_root apt-get install -y -qq --no-install-recommends "$@" >.setup.log 2>&1 && return 0
        [ -s .setup.log ] && tail -n 3 .setup.log >&2
    fi
    echo "setup: cannot install $* here; run: sudo apt-get install --no-install-recommends $*" >&2
    exit 1
}

python=""
for candidate in ${PYTHON:-} python3 python3.13 python3.12 python3.11; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then python=$candidate; break; fi
done
if [ -z "$python" ]; then
    install python3
    python=python3
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
        || { echo "setup: Python 3.11 or later is needed; install it and run: make setup PYTHON=/path/to/python3" >&2; exit 1; }
fi

if [ ! -x .venv/bin/python ] || ! cmp -s requirements.lock .venv/requirements.lock; then
    echo "setup: Python packages into .venv (a few minutes the first time)"
    if [ ! -x .venv/bin/python ] && ! "$python" -m venv .venv >.setup.log 2>&1; then
        rm -rf .venv
        install python3-venv
        "$python" -m venv .venv
    fi
    .venv/bin/python -m pip install -q --disable-pip-version-check --retries 1 --timeout 15 --require-hashes \
        -r requirements.lock >.setup.log 2>&1 || {
        grep -E '^ERROR' .setup.log | tail -n 1 >&2
        echo "setup: cannot install the Python packages; with a network to fetch them from, run make setup again" >&2
        exit 1
    }
    cp requirements.lock .venv/requirements.lock
fi

sh softfinger/command.sh .venv

if ! .venv/bin/python -c 'import gmsh, vtkmodules.vtkRenderingOpenGL2' 2>.setup.log; then
    echo "setup: libraries that gmsh and VTK load"
    install libgl1 libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 libxfixes3 libgomp1 libegl1
    .venv/bin/python -c 'import gmsh, vtkmodules.vtkRenderingOpenGL2'
fi

if ! command -v pimpleFoam >/dev/null && [ -z "${WM_PROJECT_DIR:-}" ]; then
    echo "setup: OpenFOAM"
    install openfoam
fi
.venv/bin/softfinger openfoam
# in an image too, so that its containers resume what another one began
.venv/bin/python -c 'from pipeline.runs.seal import own_key; own_key()'
echo "setup: what PIV and the virtual camera compile (half a minute)"
.venv/bin/python -m piv.precompile
rm -f .setup.log
