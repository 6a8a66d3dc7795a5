"""What goes wrong: one line that names the file and the reason."""


class OmnilifeError(Exception):
    """Every error of this package."""


class InputError(OmnilifeError, ValueError):
    """Some input is bad or missing; the caller has to change it (exit code 2 of the command)."""


class UndefinedScore(InputError):
    """A metric has no value for a view: neither 0 nor infinity would be true."""


class MachineError(OmnilifeError, OSError):
    """The machine fails, or omnilife does (exit code 1 of the command)."""
