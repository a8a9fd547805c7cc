"""The rows of a commissioning experiment on their way from the node that runs it, in blocks."""

from __future__ import annotations

from collections.abc import Callable
from math import nan

from nadrc_ros.adrc.errors import UserError
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

TOPIC = 'commission/rows'
COLUMNS = ('time', 'measurement', 'stamp', 'command', 'excitation', 'stage')
STAGES = ('start', 'rest', 'pulse', 'coast', 'brake', 'doublet', 'step', 'over', 'silent')
_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
# A block is of so long [s].
_BLOCK = 0.05

Row = list[float]


class Rows:
    """
    Publishes the ticks of an experiment on ``~/commission/rows``, a row each.

    A block has the number of its first row as ``data_offset``; the label of its first dimension is
    empty, but for the last block, where it says how the experiment ended. Times are in seconds:
    ``time`` since the beginning, ``stamp`` since the epoch.
    """

    def __init__(self, node: Node, period: float) -> None:
        self._publisher = node.create_publisher(Float64MultiArray, f'~/{TOPIC}', _QOS)
        self._size = max(1, round(_BLOCK / period))
        self._rows: list[float] = []
        self._sent = self._count = 0
        self._time = 0.0

    def begin(self) -> None:
        """Begin a new experiment."""
        self._rows, self._sent, self._count, self._time = [], 0, 0, 0.0

    def add(
        self,
        elapsed: float,
        measurement: float,
        stamp: int,
        command: float,
        excitation: float,
        stage: int,
    ) -> None:
        """Add the row of a tick ``elapsed`` [s] after the last; ``stamp`` [ns] is that of y."""
        self._time += elapsed
        stamped = stamp * 1e-9 if measurement == measurement else nan
        self._rows += (self._time, measurement, stamped, command, excitation, float(stage))
        self._count += 1
        if self._count - self._sent >= self._size:
            self._publish('')

    def end(self, said: str) -> None:
        """Send what is left, and that this was all."""
        self._publish(said)

    def _publish(self, said: str) -> None:
        size = self._count - self._sent
        width = len(COLUMNS)
        dimensions = [
            MultiArrayDimension(label=said, size=size, stride=size * width),
            MultiArrayDimension(label=' '.join(COLUMNS), size=width, stride=width),
        ]
        layout = MultiArrayLayout(dim=dimensions, data_offset=self._sent)
        self._publisher.publish(Float64MultiArray(layout=layout, data=self._rows))
        self._rows, self._sent = [], self._count


class RowsReader:
    """
    Collects the rows of the experiment that runs on a controller.

    Attributes
    ----------
    rows
        Those so far, in the order of ``COLUMNS``.
    said
        How it ended, None while it runs.

    """

    def __init__(
        self, node: Node, controller: str, took: Callable[[], None] = lambda: None
    ) -> None:
        self.rows: list[Row] = []
        self.said: str | None = None
        self._took = took
        self._lost = 0
        topic = f'{controller}/{TOPIC}'
        self.subscription = node.create_subscription(Float64MultiArray, topic, self._take, _QOS)

    def begin(self) -> None:
        """Forget the last experiment."""
        self.rows, self.said, self._lost = [], None, 0

    def refuse_lost(self) -> None:
        """
        Refuse to go on with rows of which some were lost on the way.

        Raises
        ------
        UserError
            Says how many.

        """
        if self._lost:
            raise UserError(f'{self._lost} rows of the experiment were lost on the way here')

    def _take(self, block: Float64MultiArray) -> None:
        if len(block.layout.dim) != 2:
            return
        offset, width = block.layout.data_offset, len(COLUMNS)
        if offset == 0:
            self.begin()
        self._lost += max(0, offset - len(self.rows) - self._lost)
        data = list(block.data)
        self.rows += [data[i : i + width] for i in range(0, len(data), width)]
        self.said = block.layout.dim[0].label or None
        self._took()
