"""Commands that say what a sensor does."""
