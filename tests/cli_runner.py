"""Runs the command line in this process."""

from mirte_drake.cli import main


def run_cli(capsys, *arguments):
    """Returns exit code, standard output and standard error."""
    try:
        main([str(a) for a in arguments])
        code = 0
    except SystemExit as end:
        code = end.code
    captured = capsys.readouterr()
    return code, captured.out, captured.err
