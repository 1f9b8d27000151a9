# Compiles a target with ros2.h in place of the headers of ROS 2.
set(REVISIT_ROS2 ${CMAKE_CURRENT_LIST_DIR})
function(revisit_with_ros2 target)
  foreach(header tf2_ros/buffer.h tf2_ros/transform_listener.h nav_msgs/msg/odometry.hpp rclcpp/rclcpp.hpp
                 revisit_ros/msg/loop.hpp revisit_ros/srv/locate.hpp sensor_msgs/msg/point_cloud2.hpp std_msgs/msg/header.hpp
                 visualization_msgs/msg/marker_array.hpp livox_ros_driver2/msg/custom_msg.hpp)
    file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/ros2/${header} "#include \"ros2.h\"\n")
  endforeach()
  target_include_directories(${target} PRIVATE ${CMAKE_CURRENT_BINARY_DIR}/ros2 ${REVISIT_ROS2})
  target_compile_definitions(${target} PRIVATE REVISIT_HAVE_LIVOX)
endfunction()
