# Build settings shared by every room, and the two helpers that declare libraries and tests.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "" FORCE)
endif()
# Lines for backtraces, but no variables: full debug information takes a third of the build's time.
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O3 -g1 -DNDEBUG")

find_program(WAYMARK_CCACHE ccache)
if(WAYMARK_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${WAYMARK_CCACHE})
endif()

add_library(waymark_flags INTERFACE)
target_compile_options(waymark_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Wcast-align -Woverloaded-virtual
  -fno-math-errno -fno-trapping-math)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
  # As on x86-64, where a portable program has no fused multiplication and addition.
  target_compile_options(waymark_flags INTERFACE -ffp-contract=off)
endif()
target_include_directories(waymark_flags INTERFACE "${PROJECT_SOURCE_DIR}" "${PROJECT_BINARY_DIR}")
if(WAYMARK_SANITIZE)
  # The last -O and -g win: a report needs lines, not variables, and such builds are slow enough.
  target_compile_options(waymark_flags INTERFACE
    -fsanitize=${WAYMARK_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer -O1 -g1)
  target_link_options(waymark_flags INTERFACE -fsanitize=${WAYMARK_SANITIZE})
endif()
if(WAYMARK_FUZZ)
  # The fuzzer is told which branches an input took. Some warnings are known to GCC only.
  target_compile_options(waymark_flags INTERFACE
    -fsanitize=fuzzer-no-link -Wno-unknown-warning-option)
endif()

# Most of a compilation is the headers of Eigen, OpenCV and nlohmann-json: several sources of a
# target are compiled as one, which takes a quarter to a half off a build. OFF where single files are
# compiled again and again, and for clang-tidy's list of files.
option(WAYMARK_UNITY "Compile several sources at once" ON)
set(CMAKE_UNITY_BUILD ${WAYMARK_UNITY})
if(WAYMARK_UNITY AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # Sources are included there, and anonymous namespaces with them, each in one place only.
  target_compile_options(waymark_flags INTERFACE -Wno-subobject-linkage)
endif()
set(CMAKE_UNITY_BUILD_BATCH_SIZE 8)

# Sources whose names in anonymous namespaces are those of their neighbours, too.
function(waymark_apart)
  if(NOT ARGN)
    return()
  endif()
  set_source_files_properties(${ARGN} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
endfunction()

# waymark_library(NAME SOURCES... [APART sources...] [LINK libs...]); APART: compiled one by one.
function(waymark_library name)
  cmake_parse_arguments(ARG "" "" "APART;LINK" ${ARGN})
  waymark_apart(${ARG_APART})
  add_library(${name} STATIC ${ARG_UNPARSED_ARGUMENTS} ${ARG_APART})
  target_link_libraries(${name} PUBLIC ${ARG_LINK} PRIVATE waymark_flags)
  target_include_directories(${name} PUBLIC "${PROJECT_SOURCE_DIR}")
endfunction()

# waymark_test(NAME [ALONE] SOURCES... [APART sources...] [LINK libs...]): a GoogleTest program, its
# cases known to ctest. ALONE: nothing else runs beside them.
function(waymark_test name)
  if(NOT WAYMARK_TESTS)
    return()
  endif()
  cmake_parse_arguments(ARG "ALONE" "" "APART;LINK" ${ARGN})
  waymark_apart(${ARG_APART})
  add_executable(${name} ${ARG_UNPARSED_ARGUMENTS} ${ARG_APART})
  target_link_libraries(${name} PRIVATE ${ARG_LINK} waymark_flags GTest::gtest_main)
  gtest_discover_tests(${name} DISCOVERY_TIMEOUT 60
    PROPERTIES ENVIRONMENT "WAYMARK_SHARED_DATA=${PROJECT_SOURCE_DIR}/../shared/data"
               RUN_SERIAL ${ARG_ALONE})
endfunction()
