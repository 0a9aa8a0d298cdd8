"""The command `mlivr-gym`."""
