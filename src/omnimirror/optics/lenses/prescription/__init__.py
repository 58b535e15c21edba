"""Lens prescriptions from files: tables, surfaces and glasses; sequential ray tracing."""
