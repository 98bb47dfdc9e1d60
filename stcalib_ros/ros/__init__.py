"""The ROS 2 side; its modules need rclpy and the messages that colcon builds."""
