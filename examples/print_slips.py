# SPDX-License-Identifier: Apache-2.0
"""A node of your own on the graph: prints every slip that has ended. Start a scene, then this.

It uses rclpy and the messages alone. Settings of DDS, such as ROS_DOMAIN_ID, count as for `ros2`.
"""

import rclpy
from eol_msgs.msg import Slip
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class PrintSlips(Node):
    def __init__(self) -> None:
        super().__init__('print_slips', namespace='eol')  # `--ros-args -r __ns:=/north`: another
        self.create_subscription(Slip, 'slips', self.on_slip, 60)
        print('waiting for slips', flush=True)

    def on_slip(self, slip: Slip) -> None:
        if slip.kind == Slip.KIND_STOP:
            row, column = divmod(slip.block, 5)
            far_mm, long_ms = slip.distance * 1e3, slip.duration * 1e3
            print(f'row {row} column {column}: {far_mm:.1f} mm in {long_ms:.0f} ms', flush=True)


def main() -> None:
    rclpy.init()
    try:
        rclpy.spin(PrintSlips())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # rclpy's signal handler has shut down; to do it too would be a race with that


if __name__ == '__main__':
    main()
