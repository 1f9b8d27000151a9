# Run by cpack between installing and packing: makes of the installed tree what Debian's policy asks for. It is about
# files that only a package has, or has at another place.
cmake_policy(VERSION 3.25)

function(must)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code ERROR_VARIABLE said)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "${ARGN}: ${said}")
  endif()
endfunction()

# Without it cpack would make a package that asks for nothing.
find_program(shlibdeps dpkg-shlibdeps)
if(NOT shlibdeps)
  message(FATAL_ERROR "dpkg-shlibdeps finds what the program depends on and is not here: install dpkg-dev")
endif()

find_program(help2man help2man)
if(NOT help2man)
  message(FATAL_ERROR "help2man writes the manual pages and is not here: install help2man")
endif()

string(TIMESTAMP today "%a, %d %b %Y %H:%M:%S +0000" UTC)  # or SOURCE_DATE_EPOCH's

function(document package folder)
  set(documents ${folder}/usr/share/doc/${package})
  file(MAKE_DIRECTORY ${documents})
  configure_file(${CPACK_REVISIT_PACKAGING}/copyright ${documents}/copyright COPYONLY)
  file(WRITE ${documents}/changelog.Debian
       "revisit (${CPACK_PACKAGE_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE}) unstable; urgency=medium\n\n"
       "  * What is new stands in changelog.gz.\n\n -- ${CPACK_PACKAGE_CONTACT}  ${today}\n")
  file(GLOB changes ${documents}/CHANGELOG.md)
  if(changes)
    file(RENAME ${documents}/CHANGELOG.md ${documents}/changelog)
  endif()
  file(REMOVE ${documents}/LICENSE)  # stands in copyright
  file(GLOB compressed ${documents}/changelog* ${folder}/usr/share/man/man1/*.1)
  must(gzip -9n ${compressed})
endfunction()

set(program ${CPACK_TEMPORARY_DIRECTORY}/program)
must(${CPACK_REVISIT_PACKAGING}/manual.sh ${program}/usr/bin/revisit ${program}/usr/share/man/man1)
document(revisit ${program})

set(development ${CPACK_TEMPORARY_DIRECTORY}/development)
document(librevisit-dev ${development})
file(GLOB_RECURSE pc_files ${development}/usr/*.pc)
foreach(file IN LISTS pc_files)  # with a plain path pkg-config leaves out -I/usr/include
  file(READ ${file} text)
  string(REGEX REPLACE "^prefix=[^\n]*" "prefix=/usr" text "${text}")
  file(WRITE ${file} "${text}")
endforeach()
file(GLOB_RECURSE libraries ${development}/usr/lib/*.a)
set(notes --remove-section=.comment --remove-section=.note)  # what dh_strip takes away, too
must(strip --strip-debug --enable-deterministic-archives ${notes} ${libraries})
must(strip ${notes} ${program}/usr/bin/revisit)
