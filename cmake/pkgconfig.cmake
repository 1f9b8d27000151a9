# revisit_pkg_config(NAME): revisit-NAME.pc for the library revisit_NAME, from what the target links. All of ours are static,
# so what a program must link besides is in the private fields: pkg-config --static. Libraries of others are shared, named as
# flags and not by their own .pc files: those would bring what only their static versions need (OpenBLAS: Fortran).
set(revisit_flags_protobuf::libprotobuf -lprotobuf)
list(TRANSFORM OpenMP_CXX_LIB_NAMES PREPEND -l OUTPUT_VARIABLE revisit_flags_OpenMP::OpenMP_CXX)
set(revisit_flags_hwy::hwy -lhwy)
set(revisit_flags_liblzf::liblzf -llzf)
set(revisit_flags_PNG::PNG -lpng)
set(revisit_flags_ZLIB::ZLIB -lz)
set(revisit_flags_SQLite::SQLite3 -lsqlite3)

# -lNAME for the file of a library, with its folder where the linker would not look.
function(revisit_flags_of_file file result)
  get_filename_component(folder ${file} DIRECTORY)
  get_filename_component(name ${file} NAME)
  string(REGEX REPLACE "^lib(.*)\\.(so|a)$" "\\1" name ${name})
  set(flags -l${name})
  if(NOT folder IN_LIST CMAKE_CXX_IMPLICIT_LINK_DIRECTORIES)
    list(PREPEND flags -L${folder})
  endif()
  set(${result} ${flags} PARENT_SCOPE)
endfunction()

function(revisit_pkg_config name)
  set(requires)
  set(requires_private)
  set(libs_private)
  set(cflags)
  get_target_property(linked revisit_${name} LINK_LIBRARIES)
  foreach(item IN LISTS linked)
    if(item STREQUAL "Eigen3::Eigen")  # headers, which ours include
      list(APPEND requires eigen3)
    elseif(item MATCHES "^revisit_(.*)")
      list(APPEND requires_private revisit-${CMAKE_MATCH_1})
    elseif(item MATCHES "^/")
      revisit_flags_of_file(${item} flags)
      list(APPEND libs_private ${flags})
    elseif(DEFINED "revisit_flags_${item}")
      list(APPEND libs_private ${revisit_flags_${item}})
    elseif(NOT item MATCHES "^\\$<BUILD_INTERFACE:")
      message(FATAL_ERROR "revisit_${name} links ${item}: say in cmake/pkgconfig.cmake how a linker calls that")
    endif()
  endforeach()
  get_target_property(definitions revisit_${name} INTERFACE_COMPILE_DEFINITIONS)
  foreach(definition IN LISTS definitions)
    if(definition)
      list(APPEND cflags -D${definition})
    endif()
  endforeach()
  file(RELATIVE_PATH prefix /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
  string(REGEX REPLACE "/$" "" prefix ${prefix})
  list(JOIN requires ", " requires)
  list(JOIN requires_private ", " requires_private)
  list(JOIN libs_private " " libs_private)
  list(JOIN cflags " " cflags)
  set(file ${PROJECT_BINARY_DIR}/pkgconfig/revisit-${name}.pc)
  file(CONFIGURE OUTPUT ${file} @ONLY CONTENT [[
prefix=${pcfiledir}/@prefix@
libdir=${prefix}/@CMAKE_INSTALL_LIBDIR@
includedir=${prefix}/@CMAKE_INSTALL_INCLUDEDIR@

Name: revisit-@name@
Description: @PROJECT_DESCRIPTION@ (@name@)
Version: @PROJECT_VERSION@
Requires: @requires@
Requires.private: @requires_private@
Cflags: -I${includedir} @cflags@
Libs: -L${libdir} -lrevisit_@name@
Libs.private: @libs_private@
]])
  install(FILES ${file} DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
endfunction()
