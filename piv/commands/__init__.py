"""One module per subcommand of `piv`; each has `add_arguments(parser)` and `run(args)`."""
