"""ROS 2 node of omnimirror."""
