"""Streaming gateway: serves virtual views of one camera or stream as network cameras."""
