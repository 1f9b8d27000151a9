# Read by ctest when it starts, for one program of tests: a ctest test `FOLDER.FILE` for each of its `sources`, which runs all
# that the file has. A start of the program for each of 1,700 tests took minutes, most of them under the sanitizers.
set(all "")
foreach(source IN LISTS sources)
  file(READ ${source} text)
  string(REGEX MATCHALL "\nTEST(_[FP])?\\([A-Za-z0-9_]+,[ \n]*[A-Za-z0-9_]+\\)" tests "${text}")
  set(filter "")
  foreach(test IN LISTS tests)
    string(REGEX MATCH "(_[FP])?\\(([A-Za-z0-9_]+),[ \n]*([A-Za-z0-9_]+)" found "${test}")
    if(CMAKE_MATCH_1 STREQUAL "_P")
      string(APPEND filter ":*/${CMAKE_MATCH_2}.${CMAKE_MATCH_3}/*")
    else()
      string(APPEND filter ":${CMAKE_MATCH_2}.${CMAKE_MATCH_3}")
    endif()
  endforeach()
  string(APPEND all ${filter})
  string(REGEX REPLACE ".*/(.*)_test\\.cpp$" "${folder}.\\1" name ${source})
  add_test(${name} ${program} --gtest_brief=1 --gtest_filter=${filter})
  set_tests_properties(${name} PROPERTIES TIMEOUT 900)
  if(name MATCHES "^(random_nets\\.random_nets|pipeline\\.simulation|tools\\.(eval|loops))$")
    set_tests_properties(${name} PROPERTIES COST 50)  # long ones begin first
  endif()
  if(name STREQUAL "pipeline.pcl_features")
    # It holds ours against libpcl_features, which is C++14: there clouds have Eigen's operator new, and in our C++20 the usual
    # delete. Both are malloc() and free() in the end. Nothing else links that library.
    set_tests_properties(${name} PROPERTIES ENVIRONMENT ASAN_OPTIONS=alloc_dealloc_mismatch=0)
  endif()
endforeach()
# Lists the tests that no file was found to have: there must be none.
add_test(${folder}.each_has_a_file ${program} --gtest_list_tests --gtest_filter=-${all})
set_tests_properties(${folder}.each_has_a_file PROPERTIES FAIL_REGULAR_EXPRESSION "\n  [^ ]")
