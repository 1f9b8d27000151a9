# Libraries that the pipeline can be built without; pipeline/CMakeLists.txt has the table. They are found by hand: the
# packages' own CMake files look for every module there is (PCL) or bring another BLAS (FAISS).

# revisit_optional(KEY NAME PACKAGE USE HEADER FOLDERS LIBRARIES): the option REVISIT_<KEY>, on when the header and the
# libraries are there. REVISIT_<KEY>_LIBRARIES are then their files.
function(revisit_optional key name package use header folders libraries)
  find_path(REVISIT_${key}_INCLUDE_DIR ${header} PATH_SUFFIXES ${folders})
  set(files)
  foreach(library IN LISTS libraries)
    find_library(REVISIT_${key}_${library} ${library})
    list(APPEND files ${REVISIT_${key}_${library}})
  endforeach()
  set(there ON)
  if("${REVISIT_${key}_INCLUDE_DIR};${files}" MATCHES "-NOTFOUND")
    set(there OFF)
  endif()
  option(REVISIT_${key} "${use}, by ${name}" ${there})
  if(REVISIT_${key} AND NOT there)
    message(FATAL_ERROR "REVISIT_${key} is ON, but ${name} was not found: install ${package}, or say -DREVISIT_${key}=OFF")
  elseif(REVISIT_${key})
    set(built_in true)
    set_property(GLOBAL APPEND PROPERTY revisit_have REVISIT_HAVE_${key})  # for the tests
  else()
    set(built_in false)
    message(STATUS "Without ${name}: ${use} will not work (${package}, -DREVISIT_${key}=ON)")
  endif()
  set(REVISIT_${key}_LIBRARIES ${files} CACHE INTERNAL "Files of ${name}")
  # A row of the table in recognition/src/optional_library.cpp.
  set_property(GLOBAL APPEND_STRING PROPERTY revisit_optional
               "{\"${name}\",\"${package}\",\"REVISIT_${key}\",\"${use}\",${built_in}},\n")
endfunction()

# revisit_use(TARGET KEY LIBRARIES...): compiles src/<key>/*.cpp with an optional library and those it needs itself, or
# src/<key>_absent.cpp without it.
function(revisit_use target key)
  string(TOLOWER ${key} folder)
  get_target_property(sources ${target} SOURCES)
  if(REVISIT_${key})
    list(FILTER sources EXCLUDE REGEX "/src/${folder}_absent\\.cpp$")
    target_link_libraries(${target} PRIVATE ${REVISIT_${key}_LIBRARIES} ${ARGN})
    target_include_directories(${target} SYSTEM PRIVATE ${REVISIT_${key}_INCLUDE_DIR})
  else()
    list(FILTER sources EXCLUDE REGEX "/src/${folder}/")
  endif()
  set_target_properties(${target} PROPERTIES SOURCES "${sources}")
endfunction()
