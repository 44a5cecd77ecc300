"""The program: runs are made, studied and compared from the command line."""
