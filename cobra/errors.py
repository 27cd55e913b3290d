"""The base of all errors that an operator can mend."""


class OperatorError(RuntimeError):
    """Its message is for people, in one line: what was given, where, and what would be right."""
