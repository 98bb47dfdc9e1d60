"""Files in and out: bags, results, other people's formats. No ROS installation is needed."""
