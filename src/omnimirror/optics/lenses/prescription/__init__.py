"""Lenses as files tell them: tables, surfaces and glasses; and rays through one surface after the other."""
