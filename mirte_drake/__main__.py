"""Makes ``python -m mirte_drake`` the command line."""

from mirte_drake.cli import main

main()
