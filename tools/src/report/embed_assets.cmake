# Writes OUT, a header with the page of `revisit report` before and after its data: PAGE with STYLE, LIBRARY and
# SCRIPT in their places. Run as: cmake -DOUT=.. -DPAGE=.. -DSTYLE=.. -DLIBRARY=.. -DSCRIPT=.. -P this
file(READ ${PAGE} page)
string(FIND "${page}" "@DATA@" data)
string(SUBSTRING "${page}" 0 ${data} before)
math(EXPR data "${data} + 6")
string(SUBSTRING "${page}" ${data} -1 after)

foreach(part STYLE LIBRARY SCRIPT)
  file(READ ${${part}} text)
  string(TOLOWER "${text}" lower)
  string(FIND "${lower}" "</scr" closing)
  string(FIND "${text}" ")~assets~" delimiter)
  if(NOT closing EQUAL -1 OR NOT delimiter EQUAL -1)
    message(FATAL_ERROR "${${part}} cannot be embedded: it would end its script element or literal")
  endif()
  string(REPLACE "@${part}@" "${text}" before "${before}")
  string(REPLACE "@${part}@" "${text}" after "${after}")
endforeach()

file(WRITE ${OUT} "#pragma once\n\n#include <string_view>\n\nnamespace revisit::cli::assets {\n\n"
     "inline constexpr std::string_view kBeforeData = R\"~assets~(${before})~assets~\";\n"
     "inline constexpr std::string_view kAfterData = R\"~assets~(${after})~assets~\";\n\n"
     "}  // namespace revisit::cli::assets\n")
