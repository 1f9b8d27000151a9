# Checks every #include against the arrows of HACKING.md: base <- proto <- engine <- pipeline/* <- tools and
# python, profiling -> engine, and weights_conversion -> proto. Private headers never cross a folder. Only few files include heavy
# libraries. Usage: cmake -DROOT=<project> -P layering.cmake
cmake_policy(VERSION 3.25)

set(sees_base base)
set(sees_proto proto base)
set(sees_engine engine proto base)
set(sees_engine/profiling profiling engine proto base)
set(sees_pipeline/recognition recognition engine proto base)
set(sees_pipeline/datasets datasets recognition engine proto base)
set(sees_pipeline/evaluation evaluation datasets recognition engine proto base)
set(sees_pipeline/baselines baselines datasets recognition engine proto base)
set(sees_pipeline/registration registration recognition engine proto base)
set(sees_simulator simulation datasets engine proto base)  # without recognition
set(sees_pipeline/maps maps recognition engine proto base)
set(sees_pipeline/loops loops maps registration recognition engine proto base)
set(sees_weights_conversion weights_conversion proto base)
set(sees_python loops maps evaluation registration simulation baselines datasets recognition profiling engine proto base)
set(sees_tools tools loops maps registration baselines evaluation datasets recognition profiling engine proto weights_conversion base)

set(owned_libraries
  "opencv2/|pipeline/baselines/src/opencv/|engine/include/revisit/engine/dnn.h"
  "png.h|pipeline/datasets/src/io/gray_png|tools/src/pictures/picture.cpp"
  "jpeglib.h|tools/src/pictures/picture.cpp"
  "liblzf/|pipeline/datasets/src/io/pcd"
  "pcl/|pipeline/baselines/src/pcl/"
  "embree[34]/|simulator/src/ray_caster"
  "hwy/|engine/src/kernels/|engine/profiling/src/|pipeline/recognition/src/project/|pipeline/recognition/src/align/|pipeline/recognition/src/retrieve/|pipeline/recognition/src/ring/|pipeline/registration/src/nearest_neighbors"
  "sqlite3.h|pipeline/maps/src/"
  "faiss/|pipeline/recognition/src/faiss/"
  "libpq-fe|pipeline/maps/src/postgres/"
  "cblas|engine/src/|pipeline/recognition/src/linear_algebra.cpp"
  "lapacke|pipeline/recognition/src/linear_algebra.cpp"
  "yaml-cpp/|tools/src/"
  "openssl/|tools/src/models/|tools/src/report/page"
  "ring_model.pb.h|pipeline/recognition/src/ring/model.cpp"
  "CLI/CLI.hpp|tools/src/cli/options"
  "nanobind/|python/src/")

function(complain text)
  message(SEND_ERROR "${text}")
endfunction()

foreach(layer base proto engine engine/profiling pipeline/recognition pipeline/datasets pipeline/evaluation pipeline/baselines
        pipeline/registration simulator pipeline/maps pipeline/loops weights_conversion tools python)
  file(GLOB_RECURSE sources ${ROOT}/${layer}/*.h ${ROOT}/${layer}/*.cpp)
  if(layer STREQUAL "engine")
    list(FILTER sources EXCLUDE REGEX "^${ROOT}/engine/profiling/")
  endif()
  foreach(source IN LISTS sources)
    file(RELATIVE_PATH name ${ROOT} ${source})
    file(STRINGS ${source} includes REGEX "^#include")
    foreach(line IN LISTS includes)
      if(line MATCHES "revisit/([a-z_]+)/" AND NOT CMAKE_MATCH_1 IN_LIST sees_${layer})
        complain("${name} includes ${CMAKE_MATCH_1}, which ${layer} must not see: ${line}")
      endif()
      if(line MATCHES "\\.\\./" OR line MATCHES "tests/")
        complain("${name} reaches out of its folder: ${line}")
      endif()
      foreach(entry IN LISTS owned_libraries)
        string(REPLACE "|" ";" owners "${entry}")
        list(POP_FRONT owners pattern)
        string(FIND "${line}" "<${pattern}" angle)
        if(NOT angle EQUAL -1)
          set(allowed FALSE)
          foreach(owner IN LISTS owners)
            string(FIND "${name}" "${owner}" at)
            if(at EQUAL 0)
              set(allowed TRUE)
            endif()
          endforeach()
          if(NOT allowed)
            complain("${name} must not see ${pattern}: ${line}")
          endif()
        endif()
      endforeach()
    endforeach()
  endforeach()
endforeach()
