#!/usr/bin/env bash
# Builds the package with colcon: `scripts/build.sh DISTRO FOLDER [COLCON_OPTION ...]` puts build,
# install and log into FOLDER. scripts/setup.sh DISTRO has to have run.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
distro=$1 folder=$2
shift 2
mkdir -p "$folder"
. scripts/activate.sh "$distro"
# Only the wheels below: what an earlier build installed must not serve this one.
export AMENT_PREFIX_PATH=$VIRTUAL_ENV CMAKE_PREFIX_PATH=$VIRTUAL_ENV
unset PYTHONPATH
if ! colcon --log-base "$folder/log" build --base-paths . --packages-select stcalib_ros \
  --build-base "$folder/build" --install-base "$folder/install" "$@" \
  --cmake-args -DBUILD_TESTING=OFF -DPython3_EXECUTABLE="$VIRTUAL_ENV/bin/python3" \
  >"$folder/colcon.log" 2>&1; then
  tail -n 60 "$folder/colcon.log" >&2
  echo "build: colcon failed, see above; all of it is in $folder/log" >&2
  exit 2
fi
