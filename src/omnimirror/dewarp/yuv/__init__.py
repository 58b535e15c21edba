"""Dewarping of video frames by planes in their coded format."""
