# SPDX-License-Identifier: GPL-3.0-or-later
# Everything comes from the distribution (Debian 12); nothing is downloaded at
# configure time. The comments are the traps that were met. tools/setup has the
# package names.
find_package(Threads REQUIRED)
find_package(TBB CONFIG REQUIRED)  # before OpenVDB, whose own FindTBB defines the same target
find_package(Ceres 2.1 CONFIG REQUIRED)  # before OpenVDB, too
find_package(fmt 9.1 CONFIG REQUIRED)
find_package(tl-expected 1.0 CONFIG REQUIRED)  # package libexpected-dev
find_package(OpenSSL REQUIRED COMPONENTS Crypto)
find_package(Eigen3 3.4 CONFIG REQUIRED)
find_package(nlohmann_json 3.11 CONFIG REQUIRED)
find_package(CLI11 2.1 CONFIG REQUIRED)
find_package(GDAL 3.6 CONFIG REQUIRED)
find_package(CGAL 5.5 CONFIG REQUIRED)
find_package(draco 1.5 CONFIG REQUIRED)
find_package(meshoptimizer 0.18 CONFIG REQUIRED)
find_package(nanoflann 1.4 CONFIG REQUIRED)
find_package(OpenImageIO 2.4 CONFIG REQUIRED)  # mutters about a missing PyImath; harmless
find_package(embree 3.13 CONFIG REQUIRED)      # target is plain "embree"
find_package(pugixml 1.13 CONFIG REQUIRED)
find_package(OpenMesh CONFIG REQUIRED)         # targets OpenMeshCore, OpenMeshTools

list(APPEND CMAKE_MODULE_PATH  # these two ship find modules in places CMake does not look
  "/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/OpenVDB" "/usr/share/cmake/geographiclib")
find_package(OpenVDB 10 REQUIRED COMPONENTS openvdb)
find_package(GeographicLib REQUIRED)  # sets variables only; wrapped below
add_library(GeographicLib INTERFACE)
target_link_libraries(GeographicLib INTERFACE ${GeographicLib_LIBRARIES})

find_package(OpenCASCADE CONFIG REQUIRED)  # 7.6; it answers to its exact version only
add_library(opencascade_step INTERFACE)
target_include_directories(opencascade_step SYSTEM INTERFACE ${OpenCASCADE_INCLUDE_DIR})
target_link_libraries(opencascade_step INTERFACE TKSTEP TKXSBase TKTopAlgo TKShHealing TKBRep TKernel)

find_package(PkgConfig REQUIRED)
pkg_check_modules(CAIRO REQUIRED IMPORTED_TARGET cairo>=1.16)
pkg_check_modules(HTTPLIB REQUIRED cpp-httplib>=0.11)  # package libcpp-httplib-dev
find_package(ZLIB REQUIRED)  # package zlib1g-dev
pkg_check_modules(FFTW REQUIRED IMPORTED_TARGET fftw3)
pkg_check_modules(FFTWF REQUIRED IMPORTED_TARGET fftw3f)
pkg_check_modules(TOMLPLUSPLUS REQUIRED IMPORTED_TARGET tomlplusplus)
pkg_check_modules(LIB3MF REQUIRED lib3MF)  # its .pc asks for -lzip, which is not installed with it
add_library(lib3mf INTERFACE)
target_include_directories(lib3mf SYSTEM INTERFACE ${LIB3MF_INCLUDE_DIRS})
target_link_libraries(lib3mf INTERFACE 3MF)

if(MAQUETTE_TESTS)
  find_package(GTest 1.12 CONFIG REQUIRED)
endif()
find_package(benchmark 1.7 CONFIG)  # optional: tools/bench
