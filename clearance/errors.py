"""The one error that a user can cause: a wrong input, reported as a single line with exit code 2."""


class InputError(ValueError):
    """A value, file or key given by the user cannot be used.

    The message names the value, the allowed range and the key to change; commands print it as one line and
    exit with code 2.
    """
