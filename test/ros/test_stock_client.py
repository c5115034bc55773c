# SPDX-License-Identifier: Apache-2.0
"""The calls that ros2cli makes, by stock rclpy in a process that imports nothing of the project."""

import json
import os
import subprocess
import sys

import pytest
from support.domains import next_domain

CLIENT = """\
import json, sys, time
import rclpy
from eol_msgs.msg import Request, RequestResult
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from std_srvs.srv import SetBool

rclpy.init()
node, found = rclpy.create_node('stock'), {}

def call(type_, name, request):
    client = node.create_client(type_, name)
    assert client.wait_for_service(30.0), name
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
    return future.result()

def set_to(value):
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
    request = SetParameters.Request(parameters=[Parameter(name='stop_mps', value=value)])
    (result,) = call(SetParameters, '/eol/motion/set_parameters', request).results
    return [result.successful, result.reason]

asleep = call(SetBool, '/eol/sleep', SetBool.Request(data=True))
found['sleep'] = [asleep.success, asleep.message]
request = DescribeParameters.Request(names=['stop_mps'])
(described,) = call(DescribeParameters, '/eol/motion/describe_parameters', request).descriptors
(limits,) = described.floating_point_range
found['range'] = [limits.from_value, limits.to_value]
found['set'] = [set_to(0.002), set_to(7.0)]
request = GetParameters.Request(names=['stop_mps'])
found['get'] = call(GetParameters, '/eol/motion/get_parameters', request).values[0].double_value

results = []
node.create_subscription(RequestResult, '/eol/request_results', results.append, 10)
requests = node.create_publisher(Request, '/eol/requests', 10)
end = time.monotonic() + 30
while not any(r.id == 'mine' for r in results) and time.monotonic() < end:
    if requests.get_subscription_count() >= 2:
        requests.publish(Request(id='mine', kind='slep'))
    rclpy.spin_once(node, timeout_sec=0.5)
found['unknown'] = [r.reason for r in results if r.id == 'mine'][0]
while len(node.get_node_names()) < 3 and time.monotonic() < end + 30:
    rclpy.spin_once(node, timeout_sec=0.5)  # names come apart from topics
found['nodes'] = sorted(f'{space}/{name}' for name, space in node.get_node_names_and_namespaces())
found['topics'] = dict(node.get_topic_names_and_types())
found['services'] = dict(node.get_service_names_and_types())
found['imports'] = sorted(name for name in sys.modules if name.startswith('eol_ros'))
print(json.dumps(found))
"""


@pytest.mark.slow
def test_stock_rclpy_lists_reads_sets_calls_and_asks(tmp_path):
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(next_domain()), 'PYTHONPATH': ''}
    command = [sys.executable, '-m', 'eol_ros.nodes', 'motion', 'montage']
    nodes = subprocess.Popen(command, env=environment)
    try:
        done = subprocess.run(
            [sys.executable, '-c', CLIENT],
            env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120,
        )  # fmt: skip
    finally:
        nodes.terminate()
        nodes.wait()
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found['imports'] == []
    assert {'/eol/motion', '/eol/montage'} <= set(found['nodes'])
    assert found['topics']['/eol/slips'] == ['eol_msgs/msg/Slip']
    assert found['services']['/eol/sleep'] == ['std_srvs/srv/SetBool']
    assert found['sleep'][0] is True
    assert found['range'] == [0.0, 1.0] and found['get'] == 0.002
    (good, _), (bad, why) = found['set']
    assert good and not bad and 'stop_mps' in why
    assert found['unknown'] == 'slep: no such request. Did you mean sleep?'
