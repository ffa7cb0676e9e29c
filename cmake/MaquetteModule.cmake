# SPDX-License-Identifier: GPL-3.0-or-later
include_guard()

# Fills <out> with the rooms that <module> may use, according to layers.txt. Stops
# the configure run if a room names one that stands below it, so a cycle cannot be
# written down.
function(maquette_allowed_modules module out)
  file(STRINGS "${PROJECT_SOURCE_DIR}/cmake/layers.txt" lines REGEX "^[a-z]")
  set_property(DIRECTORY "${PROJECT_SOURCE_DIR}" APPEND PROPERTY
    CMAKE_CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/cmake/layers.txt")
  set(above)
  foreach(line IN LISTS lines)
    string(REGEX MATCH "^([a-z_]+):(.*)$" _ "${line}")
    set(name "${CMAKE_MATCH_1}")
    separate_arguments(allowed UNIX_COMMAND "${CMAKE_MATCH_2}")
    foreach(dep IN LISTS allowed)
      if(NOT dep IN_LIST above)
        message(FATAL_ERROR "layers.txt: '${name}' uses '${dep}', which does not stand above it")
      endif()
    endforeach()
    if(name STREQUAL module)
      set(${out} "${allowed}" PARENT_SCOPE)
      return()
    endif()
    list(APPEND above "${name}")
  endforeach()
  message(FATAL_ERROR "layers.txt has no line for '${module}'")
endfunction()

# maquette_add_module(cnc
#   HEADERS ...        public headers, next to their .cpp
#   SOURCES ...        every .cpp, spelled out; no globbing
#   HEAVY_SOURCES ...  .cpp that include CGAL, OpenVDB, OpenMesh: compiled one at a
#                      time, since one of them can take 1.7 GB
#   PUBLIC_LIBS ...    third-party targets that appear in public headers
#   PRIVATE_LIBS ...   third-party targets used in .cpp files only
# )
# Creates maquette_cnc and the alias maquette::cnc. The rooms it links come from
# layers.txt and are not repeated here.
function(maquette_add_module module)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" ""
    "HEADERS;SOURCES;HEAVY_SOURCES;PUBLIC_LIBS;PRIVATE_LIBS")
  if(arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "maquette_add_module(${module}): what is '${arg_UNPARSED_ARGUMENTS}'?")
  endif()
  maquette_allowed_modules(${module} allowed)
  list(TRANSFORM allowed PREPEND "maquette::")

  set(target maquette_${module})
  add_library(${target} STATIC ${arg_SOURCES})
  add_library(maquette::${module} ALIAS ${target})
  target_sources(${target} PUBLIC FILE_SET HEADERS
    BASE_DIRS "${PROJECT_SOURCE_DIR}" FILES ${arg_HEADERS})
  target_link_libraries(${target} PUBLIC ${allowed} ${arg_PUBLIC_LIBS}
    PRIVATE maquette_flags ${arg_PRIVATE_LIBS})
  target_compile_features(${target} PUBLIC cxx_std_20)
  set_target_properties(${target} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON)
  if(MAQUETTE_PCH)
    target_precompile_headers(${target} PRIVATE
      <algorithm> <array> <cmath> <functional> <span> <string> <vector> <fmt/format.h>)
  endif()

  if(arg_HEAVY_SOURCES)
    set_property(GLOBAL PROPERTY JOB_POOLS heavy=1)
    add_library(${target}_heavy OBJECT ${arg_HEAVY_SOURCES})
    target_include_directories(${target}_heavy PRIVATE "${PROJECT_SOURCE_DIR}")
    target_link_libraries(${target}_heavy PRIVATE
      maquette_flags ${allowed} ${arg_PUBLIC_LIBS} ${arg_PRIVATE_LIBS})
    set_target_properties(${target}_heavy PROPERTIES JOB_POOL_COMPILE heavy)
    target_sources(${target} PRIVATE $<TARGET_OBJECTS:${target}_heavy>)
  endif()
endfunction()

# maquette_add_test(cnc cutter_location_test.cpp [LABELS slow] [LIBS ...])
# One executable per test file: a crash names its file, and a rebuild after an edit
# links one small program.
function(maquette_add_test module source)
  cmake_parse_arguments(PARSE_ARGV 2 arg "" "" "LABELS;LIBS")
  get_filename_component(stem "${source}" NAME_WE)
  set(target ${module}_${stem})
  add_executable(${target} ${PROJECT_SOURCE_DIR}/tests/${module}/${source})
  target_link_libraries(${target} PRIVATE
    maquette::${module} maquette_flags maquette_test_support GTest::gmock_main ${arg_LIBS})
  if(MAQUETTE_PCH)
    target_precompile_headers(${target} REUSE_FROM maquette_test_pch)
  endif()
  # One label, joined by dots: "cnc.slow". A list would be flattened on its way into
  # the generated file, losing all labels but the first without a word.
  string(JOIN "." label ${module} ${arg_LABELS})
  gtest_discover_tests(${target}
    TEST_PREFIX "${module}."
    PROPERTIES TIMEOUT 300 LABELS "${label}"
    DISCOVERY_TIMEOUT 60)
endfunction()
