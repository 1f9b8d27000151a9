# Installs the build tree into a scratch folder, builds pipeline/whole_path.cpp and loop_closure.cpp against it and
# asks them for places.
#   cmake -DBUILD=<build tree> -DSOURCE=<tests/consumer> -DGENERATOR=... -P run.cmake
cmake_policy(VERSION 3.25)
set(work ${BUILD}/tests/consumer_work)
file(REMOVE_RECURSE ${work})
file(MAKE_DIRECTORY ${work})
function(must)
  execute_process(COMMAND ${ARGN} WORKING_DIRECTORY ${work} RESULT_VARIABLE code OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "${ARGN}\n${out}")
  endif()
  set(out "${out}" PARENT_SCOPE)
endfunction()
must(${CMAKE_COMMAND} --install ${BUILD} --prefix ${work}/prefix)
must(${CMAKE_COMMAND} -S ${SOURCE} -B ${work}/build -G ${GENERATOR} -DCMAKE_PREFIX_PATH=${work}/prefix
     -DWHOLE_PATH=${SOURCE}/../../pipeline/whole_path.cpp -DLOOP_CLOSURE=${SOURCE}/../../pipeline/loop_closure.cpp
     -DCMAKE_CXX_FLAGS=${FLAGS} -DCMAKE_BUILD_TYPE=Debug)
must(${CMAKE_COMMAND} --build ${work}/build)

# The first place again, seen by a vehicle that has turned by a quarter.
set(first "5 15 2 1\n40 -30 1 1\n-7 2 -1 1\n9 5 0.5 1\n-60 -70 -3 1\n")
set(second "15 5 1 1\n-4 30 1 1\n-7 -20 -2 1\n1 50 0.5 1\n-30 -9 3 1\n")
set(first_again "15 -5 2 1\n-30 -40 1 1\n2 7 -1 1\n5 -9 0.5 1\n-70 60 -3 1\n")
foreach(scan first second first_again)
  file(WRITE ${work}/${scan}.pcd "VERSION .7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
       "WIDTH 5\nHEIGHT 1\nPOINTS 5\nDATA ascii\n${${scan}}")
endforeach()
must(${work}/prefix/bin/revisit models make-random -o ${work})
must(${work}/build/whole_path alexnet_random.prototxt alexnet_random.caffemodel first.pcd second.pcd first_again.pcd)
if(NOT out MATCHES "first_again.pcd is where first.pcd was taken, score ")
  message(FATAL_ERROR "found: ${out}")
endif()
foreach(known 3 6)  # the second time it knows the places of the first
  must(${work}/build/loop_closure places.map first.pcd second.pcd first_again.pcd)
  if(NOT out MATCHES "${known} places known")
    message(FATAL_ERROR "expected ${known} places, found: ${out}")
  endif()
endforeach()
file(GLOB_RECURSE headers ${work}/prefix/include/*.h)
foreach(header IN LISTS headers)
  file(STRINGS ${header} bad REGEX "#include.*(google/protobuf|pb\\.h|pcl/|opencv|embree|sqlite)")
  if(bad)
    message(FATAL_ERROR "${header}: ${bad}")
  endif()
endforeach()
file(REMOVE_RECURSE ${work})
