"""Exit codes of the command, and how long it may take to end when Ctrl-C interrupts it."""

SUCCESS, FAILED, REFUSED, NO_PLAN = 0, 1, 2, 3

EXIT_CODES = """exit codes:
  0    success
  1    the run failed: a plan failed in simulation, a relation of Table I does not hold, a
       table could not be stored, or `doctor` found that a requirement is missing
  2    wrong usage or invalid input
  3    no plan: none exists, the start cannot be held, or the limit was reached
  130  interrupted
"""

GRACE = 1.0
"""Time that a command has to respond to an interruption before its process is ended [s]."""

LONG_GRACE = 60.0
"""The same for commands that write a checkpoint when they are interrupted [s]."""
