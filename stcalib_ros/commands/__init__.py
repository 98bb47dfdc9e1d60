"""What the subcommands of ``stcalib`` do: a module each, imported when it is called."""
