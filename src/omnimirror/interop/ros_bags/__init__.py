"""ROS bags (rosbag2, MCAP, ROS 1): dewarped views with camera_info and TF frames."""
