"""Commands that measure a built sensor, and take cameras from one program to another."""
