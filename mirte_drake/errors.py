"""The error that a user can mend."""


class UserError(ValueError):
    """Bad input from outside: one line that names the place, the value and the remedy.

    The command line prints it without a traceback and ends with exit code 2.
    """
