"""The command `flatquad`: one file for each sub-command, registered in `app`."""
