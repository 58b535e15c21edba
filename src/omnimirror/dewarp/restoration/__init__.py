"""Pictures sharpened by what is known of their blur and noise."""
