# Debian packages by cpack: `revisit`, the program, and `librevisit-dev`, the libraries. docs/INSTALL.md says how.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME revisit)
set(CPACK_PACKAGE_VENDOR "The revisit developers")
# The maintainer is whoever makes the package: Debian's tools have these variables for that.
if(DEFINED ENV{DEBEMAIL})
  set(maintainer "$ENV{DEBFULLNAME} <$ENV{DEBEMAIL}>")
else()
  set(maintainer "The revisit developers <root@localhost>")
endif()
set(CPACK_PACKAGE_CONTACT "${maintainer}" CACHE STRING "Maintainer of the packages: NAME <ADDRESS>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")  # each package has its own, the first line of its description
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_COMPONENTS_ALL program development)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_CURRENT_LIST_DIR}/as_debian.cmake)
set(CPACK_REVISIT_PACKAGING ${CMAKE_CURRENT_LIST_DIR})

set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME revisit)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION "${PROJECT_DESCRIPTION}
Recognizes the scans in which a robot returns to a place, from any direction
and without an initial pose, and estimates the relative pose with its
covariance. Reads and runs original Caffe networks without Caffe.
.
This package has the program, its manual and completion for shells.")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "ca-certificates, curl")  # revisit models fetch

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME librevisit-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION "loop closure detection for LiDAR SLAM - development files
Recognizes the scans in which a robot returns to a place, from any direction
and without an initial pose, and estimates the relative pose with its
covariance. Reads and runs original Caffe networks without Caffe.
.
This package has the static libraries, their headers, and files for CMake's
find_package(revisit) and for pkg-config.")
# What the libraries' users compile and link with. The test packages.contents holds the list against the files.
set(depends libprotobuf-dev libopenblas-dev libhwy-dev)
set(recommends)
if(REVISIT_PIPELINE)
  list(APPEND depends libeigen3-dev liblzf-dev libpng-dev libembree-dev libsqlite3-dev zlib1g-dev)
endif()
get_target_property(engine_links revisit_engine LINK_LIBRARIES)
if(engine_links MATCHES "/(openblas-[a-z]+)/")  # the exported targets name this one of OpenBLAS's builds
  list(APPEND depends lib${CMAKE_MATCH_1}-dev)
endif()
if(REVISIT_FAISS)
  list(APPEND depends libfaiss-dev)
endif()
if(REVISIT_POSTGRES)
  list(APPEND depends libpq-dev)
endif()
# The competitors alone need these, which take gigabytes.
if(REVISIT_PCL)
  list(APPEND recommends libpcl-dev)
endif()
if(REVISIT_OPENCV)
  list(APPEND recommends libopencv-core-dev libopencv-features2d-dev)
endif()
list(JOIN depends ", " CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS)
list(JOIN recommends ", " CPACK_DEBIAN_DEVELOPMENT_PACKAGE_RECOMMENDS)
include(CPack)
