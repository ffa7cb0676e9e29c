# SPDX-License-Identifier: GPL-3.0-or-later
# Usage requirements for our own targets only.
add_library(maquette_flags INTERFACE)
target_compile_options(maquette_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wnon-virtual-dtor
  -Wimplicit-fallthrough $<$<BOOL:${MAQUETTE_WERROR}>:-Werror>
  # A fused multiply-add may or may not be used from one build to the next;
  # without it the same terrain gives the same toolpath everywhere.
  -ffp-contract=off)
# x86-64-v3 (AVX2) is every machine since 2013 on which 16 M polygons make sense.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(maquette_flags INTERFACE -march=x86-64-v3)
endif()
if(MAQUETTE_SANITIZE)
  target_compile_options(maquette_flags INTERFACE -fsanitize=${MAQUETTE_SANITIZE}
    -fno-omit-frame-pointer)
  target_link_options(maquette_flags INTERFACE -fsanitize=${MAQUETTE_SANITIZE})
endif()

# ccache makes the second build of the same text free, in another checkout too (paths are hashed
# from its base folder on); the sloppiness is what its manual asks for with precompiled headers.
find_program(CCACHE ccache)
if(CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER
    ${CMAKE_COMMAND} -E env "CCACHE_BASEDIR=${PROJECT_SOURCE_DIR}"
    CCACHE_SLOPPINESS=pch_defines,time_macros CCACHE_PCH_EXTSUM=true ${CCACHE})
endif()
if(MAQUETTE_PCH)
  add_compile_options($<$<CXX_COMPILER_ID:GNU>:-fpch-preprocess>)
endif()
# Debian's mold links a program in a tenth of the time of ld.
find_program(MOLD mold)
if(MOLD)
  add_link_options(-fuse-ld=mold)
endif()
