"""Commands that write what other programs take."""
