"""Recordings of robots (rosbag2, MCAP) straightened: views with their camera_info and their places in the TF tree."""
