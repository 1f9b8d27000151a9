# Writes OUT, a header with the texts that `revisit report` puts into its pages: STYLE, SCRIPT and,
# when there is one, LIBRARY. Run as: cmake -DOUT=.. -DSTYLE=.. -DSCRIPT=.. -DLIBRARY=.. -P this
function(literal name file result)
  set(text "")
  if(file)
    file(READ ${file} text)
  endif()
  string(TOLOWER "${text}" lower)
  string(FIND "${lower}" "</scr" closing)
  string(FIND "${text}" ")~assets~" delimiter)
  if(NOT closing EQUAL -1 OR NOT delimiter EQUAL -1)
    message(FATAL_ERROR "${file} cannot be embedded: it would end its script element or literal")
  endif()
  set(${result} "inline constexpr std::string_view ${name} = R\"~assets~(${text})~assets~\";\n" PARENT_SCOPE)
endfunction()

literal(kStyle "${STYLE}" style)
literal(kScript "${SCRIPT}" script)
literal(kPlotLibrary "${LIBRARY}" library)
file(WRITE ${OUT} "#pragma once\n\n#include <string_view>\n\nnamespace revisit::cli::assets {\n\n"
     "${style}${script}${library}\n}  // namespace revisit::cli::assets\n")
