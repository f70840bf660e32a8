"""The ROS nodes: messages and parameters in, messages out. Every decision lies elsewhere."""

import sys
from types import TracebackType


def _without_a_traceback(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Ctrl-C while Python still imports ROS is no error to look into."""
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _without_a_traceback
