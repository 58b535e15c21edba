"""Interoperability with other programs: ray tables, view maps, ROS bags, COLMAP, streaming, PyTorch."""
