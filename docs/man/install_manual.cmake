# When Waymark is installed: writes the manual pages, compressed as Debian wants them (man reads
# either). Wants `pages`, their names; `source`, this folder; `output`, a folder for the results; `example`, the example
# configuration; and `version`.
set(VERSION "${version}")
set(DATADIR "${CMAKE_INSTALL_PREFIX}/share")
# Escaped for troff.
file(READ "${example}" EXAMPLE)
string(REPLACE "\\" "\\e" EXAMPLE "${EXAMPLE}")
string(REPLACE "-" "\\-" EXAMPLE "${EXAMPLE}")
string(REGEX REPLACE "(^|\n)([.'])" "\\1\\\\&\\2" EXAMPLE "${EXAMPLE}")
string(STRIP "${EXAMPLE}" EXAMPLE)

foreach(page IN LISTS pages)
  configure_file("${source}/${page}.in" "${output}/${page}" @ONLY)
  # Without name and time: the same source gives the same bytes.
  execute_process(COMMAND gzip -9 --no-name --stdout "${output}/${page}"
                  OUTPUT_FILE "${output}/${page}.gz" COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCH "[0-9]$" section "${page}")
  file(INSTALL "${output}/${page}.gz"
       DESTINATION "${CMAKE_INSTALL_PREFIX}/share/man/man${section}")
endforeach()
