# Warnings, sanitizers and ccache, in one interface library that every target of ours links.
add_library(revisit_build_flags INTERFACE)
target_compile_options(revisit_build_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wold-style-cast -Wnon-virtual-dtor
  -Wno-missing-field-initializers  # designated initializers leave the defaults on purpose
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>)  # g++ 12 warns falsely about std::string operator+ (GCC bug 105651)
# A file of a batch is a header to g++, which then warns of a class that has a field of an anonymous namespace.
target_compile_options(revisit_build_flags INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
# g++ collects garbage from 128 MB on, which is a tenth of the time to compile a batch. The largest batch takes 1.2 GB either way.
add_compile_options($<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:--param=ggc-min-heapsize=524288>)  # kB
if(REVISIT_WERROR)
  target_compile_options(revisit_build_flags INTERFACE -Werror)
endif()

if(REVISIT_FUZZ)
  add_compile_options(-fsanitize=fuzzer-no-link)
endif()
if(REVISIT_SANITIZE)
  # Sanitizer code makes g++ 12 warn falsely, e.g. inside <regex>; the plain build has the warning on.
  target_compile_options(revisit_build_flags INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  # Null pointers and accesses outside of an object stop the address sanitizer, too. Checked twice they are a quarter of the
  # time to compile.
  add_compile_options(-fsanitize=${REVISIT_SANITIZE} -fno-sanitize=null,object-size,pointer-overflow
                      -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${REVISIT_SANITIZE})
  if(REVISIT_SANITIZE STREQUAL thread)
    add_compile_options("$<$<COMPILE_LANGUAGE:CXX>:SHELL:-include ${PROJECT_SOURCE_DIR}/tests/tsan_protobuf.h>")
  endif()
  set(REVISIT_NO_SANITIZER -fno-sanitize=all)  # for generated code, which takes minutes to instrument
endif()

find_program(REVISIT_CCACHE ccache)
if(REVISIT_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # g++ itself says what a file includes (DEPEND): a build that finds nothing takes 6 % longer, not 17 %.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_DEPEND=1 ${REVISIT_CCACHE})
endif()

# revisit_simd_targets(TARGET): what Highway compiles its kernels for: AVX-512, AVX2 and what every x86 has, or NEON. SVE
# registers have no size at compile time: arrays of them do not exist. The sources are the same for every target: of AVX2
# and AVX-512 a sanitizer sees one, which every machine has.
function(revisit_simd_targets target)
  set(disabled HWY_SSSE3|HWY_SSE4|HWY_SVE|HWY_SVE2|HWY_SVE_256|HWY_SVE2_128)
  if(REVISIT_SANITIZE)
    string(APPEND disabled |HWY_AVX3)
  endif()
  target_compile_definitions(${target} PRIVATE "HWY_DISABLED_TARGETS=(${disabled})")
endfunction()

# Batches read headers once for many files. Files that Highway includes once for every target stay by themselves.
if(REVISIT_UNITY)
  set(CMAKE_UNITY_BUILD ON)
  set(CMAKE_UNITY_BUILD_BATCH_SIZE ${REVISIT_UNITY})
endif()

# revisit_alone(FILES...): these are not compiled in batches.
function(revisit_alone)
  set_source_files_properties(${ARGN} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
endfunction()

# What is faster with more than -O1 is compiled so in a release and in the developer build.
set(REVISIT_OPTIMIZED $<CONFIG:Release>)
if(NOT REVISIT_SANITIZE AND NOT REVISIT_FUZZ)
  set(REVISIT_OPTIMIZED $<CONFIG:Release,RelWithDebInfo>)
endif()

# revisit_optimize(TARGET): runs for every scan or layer.
function(revisit_optimize target)
  target_compile_options(${target} PRIVATE $<${REVISIT_OPTIMIZED}:-O2>)
endfunction()

# revisit_batch(TARGET BATCH FILES...): the list of files BATCH gets one more, which includes FILES instead of compiling each.
# With HIGHWAY it is compiled once for every target of Highway, as each of the files is by itself.
function(revisit_batch target list)
  cmake_parse_arguments(PARSE_ARGV 2 batch HIGHWAY "" "")
  if(NOT batch_UNPARSED_ARGUMENTS)
    return()
  endif()
  list(GET batch_UNPARSED_ARGUMENTS 0 first)
  file(RELATIVE_PATH first ${CMAKE_CURRENT_SOURCE_DIR}/src ${first})
  string(REPLACE / _ first ${first})
  set(batch ${CMAKE_CURRENT_BINARY_DIR}/batch_${first})
  set(content "")
  foreach(file IN LISTS batch_UNPARSED_ARGUMENTS)
    string(APPEND content "#include \"${file}\"\n")
  endforeach()
  if(batch_HIGHWAY)
    set(self "#define HWY_TARGET_INCLUDE \"${batch}\"\n")
    set(content "${self}#include <hwy/foreach_target.h>\n${content}#undef HWY_TARGET_INCLUDE\n${self}")
  endif()
  file(CONFIGURE OUTPUT ${batch} CONTENT "${content}" @ONLY)
  set_source_files_properties(${batch_UNPARSED_ARGUMENTS} PROPERTIES HEADER_FILE_ONLY ON)
  target_sources(${target} PRIVATE ${batch})
  set(${list} ${${list}} ${batch} PARENT_SCOPE)
endfunction()

# revisit_kernels(TARGET FILES... [BATCH] [DEFINE NAME=VALUE]): where a program spends its time: with -O3. By -O2 g++ leaves
# loops of any length scalar: cosines take 1.8 times as long, sums of plain values 2.5 times. Elsewhere -O3 compiles for longer,
# and little is faster. BATCH: in batches, those of Highway of four files, because Highway's headers alone take 1.5 s.
# Sanitizers have options for single files.
function(revisit_kernels target)
  cmake_parse_arguments(PARSE_ARGV 1 kernels BATCH DEFINE "")
  list(TRANSFORM kernels_UNPARSED_ARGUMENTS REPLACE "^src/" "${CMAKE_CURRENT_SOURCE_DIR}/src/" OUTPUT_VARIABLE files)
  if(kernels_BATCH AND REVISIT_UNITY AND NOT REVISIT_SANITIZE AND NOT REVISIT_FUZZ)
    set(plain "")
    foreach(file IN LISTS files)
      file(STRINGS ${file} targets REGEX "foreach_target.h")
      if(NOT targets)
        list(APPEND plain ${file})
      endif()
    endforeach()
    set(highway ${files})
    list(REMOVE_ITEM highway ${plain} "")
    set(files "")
    revisit_batch(${target} files ${plain})
    while(highway)
      list(SUBLIST highway 0 4 four)
      list(REMOVE_ITEM highway ${four})
      revisit_batch(${target} files ${four} HIGHWAY)
    endwhile()
  endif()
  revisit_alone(${files})
  set_property(SOURCE ${files} APPEND PROPERTY COMPILE_OPTIONS $<${REVISIT_OPTIMIZED}:-O3>)
  set_property(SOURCE ${files} APPEND PROPERTY COMPILE_DEFINITIONS ${kernels_DEFINE})
endfunction()

# revisit_schema(TARGET FILES): protobuf's code for them, compiled apart from ours, as it does not meet our warnings. Without
# optimization: values are read by protobuf's library, so that a network loads as fast.
function(revisit_schema target files)
  set(sources "")
  foreach(file IN LISTS files)  # not by protobuf_generate(), which cannot give protoc 3.12 of Ubuntu 22.04 its option
    string(REGEX REPLACE "proto$" "pb" generated ${CMAKE_CURRENT_BINARY_DIR}/${file})
    add_custom_command(OUTPUT ${generated}.cc ${generated}.h DEPENDS ${file} protobuf::protoc VERBATIM
                       COMMAND protobuf::protoc --experimental_allow_proto3_optional --cpp_out=${CMAKE_CURRENT_BINARY_DIR}
                               -I ${CMAKE_CURRENT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR}/${file})
    list(APPEND sources ${generated}.cc ${generated}.h)
  endforeach()
  add_library(${target} OBJECT ${sources})
  set_target_properties(${target} PROPERTIES UNITY_BUILD OFF)  # each file has the same static names
  target_link_libraries(${target} PUBLIC protobuf::libprotobuf)
  target_include_directories(${target} SYSTEM PUBLIC ${CMAKE_CURRENT_BINARY_DIR})
  target_compile_options(${target} PRIVATE -O0 -w ${REVISIT_NO_SANITIZER})
endfunction()

# revisit_library(NAME DEPENDS...): a static library from src/**.cpp with public headers in include/, installed as
# the component NAME of the package (cmake/revisitConfig.cmake).
function(revisit_library name)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/src/*.cpp)
  add_library(revisit_${name} STATIC ${sources})
  add_library(revisit::${name} ALIAS revisit_${name})
  target_include_directories(revisit_${name}
    PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>
    PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/src)
  target_link_libraries(revisit_${name} PUBLIC ${ARGN} PRIVATE $<BUILD_INTERFACE:revisit_build_flags>)
  target_compile_features(revisit_${name} PUBLIC cxx_std_20)
  set_target_properties(revisit_${name} PROPERTIES EXPORT_NAME ${name})
  install(TARGETS revisit_${name} EXPORT revisit_${name} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
  install(DIRECTORY include/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development
          PATTERN net_file.h EXCLUDE)  # it hands out protobuf's messages, which are ours alone
  install(EXPORT revisit_${name} NAMESPACE revisit:: FILE ${name}.cmake
          DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/revisit COMPONENT development)
  set_property(GLOBAL APPEND PROPERTY revisit_libraries ${name})
endfunction()
