# To be sourced in bash: `. scripts/activate.sh [jazzy|kilted]` gives a shell with ROS 2, the test
# tools and, once it is built, the package: `stcalib` and `ros2 run` are commands there. `make env` sets up and builds what this activates.

_stcalib_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export ROS_DISTRO=${1:-jazzy}

# Another ROS that this shell knows must not mix with ours.
unset PYTHONPATH LD_LIBRARY_PATH COLCON_PREFIX_PATH COLCON_CURRENT_PREFIX
. "$_stcalib_root/.venv-$ROS_DISTRO/bin/activate"
export AMENT_PREFIX_PATH=$VIRTUAL_ENV CMAKE_PREFIX_PATH=$VIRTUAL_ENV

# Nothing leaves this machine, and nothing is written outside the checkout.
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
export ROS_HOME=$_stcalib_root/.ros/home COLCON_HOME=$_stcalib_root/.ros/colcon
export ROS_LOG_DIR=$ROS_HOME/log MPLCONFIGDIR=$VIRTUAL_ENV/matplotlib

if [ -f "$_stcalib_root/.ros/$ROS_DISTRO/install/setup.bash" ]; then
  . "$_stcalib_root/.ros/$ROS_DISTRO/install/setup.bash"
fi
# `stcalib`, and of `ros2` what the wheels lack: `ros2 run`.
export PATH=$_stcalib_root/scripts/bin:$PATH
unset _stcalib_root
