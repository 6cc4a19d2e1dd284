#!/usr/bin/env bash
# usage: petsc.sh ENVIRONMENT NEW
# Makes the environment NEW with the packages of ENVIRONMENT, petsc4py, slepc4py, mpi4py and pymetis. petsc4py is built
# against the PETSc of the distribution, which is installed first where that is possible. Where it is not, the file
# NEW/skipped says why.
set -euo pipefail
base=$(cd "$1" && pwd)
mkdir -p "$2"
new=$(cd "$2" && pwd)
rm -f "$new/skipped"
skip() { echo "$1" | tee "$new/skipped"; exit 0; }

"$base/bin/python" -m venv "$new"
site=$("$new/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
packages=$("$base/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
echo "import site; site.addsitedir('$packages')" >"$site/first_environment.pth"
# MKL is looked for below the environment that runs.
for library in "$base"/lib/lib*.so*; do [ ! -e "$library" ] || ln -sf "$library" "$new/lib/"; done
modules='import mpi4py, petsc4py, pymetis, slepc4py'
if "$new/bin/python" -c "$modules" 2>/dev/null; then exit 0; fi

command -v apt-get >/dev/null || skip "no apt-get: PETSc is taken from Debian or Ubuntu"
if ! dpkg -l 'libslepc-real3.*-dev' 2>/dev/null | grep -q '^ii'; then
    [ "$(id -u)" = 0 ] || skip "PETSc is not installed, and only root may install it"
    export DEBIAN_FRONTEND=noninteractive
    timeout 300 apt-get update -qq >/dev/null 2>&1 || skip "apt-get update fails"
    slepc=$(apt-cache search --names-only '^libslepc-real3[.][0-9]+-dev$' | cut -d' ' -f1 | tail -n 1)
    [ -n "$slepc" ] || skip "this distribution has no SLEPc with real numbers"
    timeout 600 apt-get install -y -qq --no-install-recommends "$slepc" libopenblas0 openmpi-bin libopenmpi-dev \
        >/dev/null 2>&1 || skip "apt-get cannot install $slepc"
fi
prefix() { dpkg -L "$(dpkg -l "$1" | awk '/^ii/ {print $2; exit}')" | sed -n "s,/include/$2\$,,p" | head -n 1; }
PETSC_DIR=$(prefix 'libpetsc-real3.*-dev' petscversion.h)
SLEPC_DIR=$(prefix 'libslepc-real3.*-dev' slepcversion.h)
export PETSC_DIR SLEPC_DIR
version=$(awk '/define PETSC_VERSION_(MAJOR|MINOR)/ {printf s $3; s="."}' "$PETSC_DIR/include/petscversion.h")
pip() { "$new/bin/python" -m pip install --quiet "$@"; }
pip 'cython<3' 'setuptools<70' wheel mpi4py pymetis
pip --no-build-isolation --no-deps "petsc4py==$version.*"
pip --no-build-isolation --no-deps "slepc4py==$version.*"
"$new/bin/python" -c "$modules"
