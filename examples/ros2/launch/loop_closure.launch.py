"""ros2 launch revisit_ros loop_closure.launch.py points:=/velodyne_points map:=town.map"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {'points': '/points', 'livox': '/livox/lidar', 'odometry': '/odom', 'map': '', 'drive': 'ros', 'poses': 'tf'}


def generate_launch_description():
    values = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    return LaunchDescription([DeclareLaunchArgument(name, default_value=value) for name, value in ARGUMENTS.items()] + [
        Node(package='revisit_ros', executable='loop_closure_node', name='loop_closure', output='screen',
             remappings=[(name, values[name]) for name in ('points', 'livox', 'odometry')],
             parameters=[{name: values[name] for name in ('map', 'drive', 'poses')}])])
