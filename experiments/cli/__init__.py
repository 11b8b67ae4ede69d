"""The command `flatquad`, one file a command."""
