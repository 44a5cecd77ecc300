"""One module per subcommand of `python -m piv`; each has `add_arguments(parser)` and `run(args)`."""
