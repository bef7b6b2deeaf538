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


def check_wrong_use(capsys, arguments, words):
    """Checks for exit code 2 and one line that has all the words."""
    code, _, err = run_cli(capsys, *arguments)
    assert code == 2
    lines = [line for line in err.splitlines() if line.startswith("Error: ")]
    assert len(lines) == 1 and "Traceback" not in err
    for word in words:
        assert word in lines[0]
