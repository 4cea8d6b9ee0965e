# SPDX-License-Identifier: Apache-2.0
# One helper per kind of target. Every target lists its files explicitly.
include_guard()

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)

# Compile and link options that every target of ours gets and no user of ours sees.
function(shiftmap_private_options target)
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wnon-virtual-dtor
    $<$<BOOL:${SHIFTMAP_WERROR}>:-Werror>)
  # At -O3 GCC 12 takes the copy of a short std::string for one that overlaps.
  target_compile_options(${target} PRIVATE $<$<AND:$<CONFIG:Release>,$<CXX_COMPILER_ID:GNU>>:-Wno-restrict>)
  # A unity build includes a .cc, in which a private class may have members of unnamed namespaces.
  target_compile_options(${target} PRIVATE $<$<AND:$<BOOL:${CMAKE_UNITY_BUILD}>,$<CXX_COMPILER_ID:GNU>>:-Wno-subobject-linkage>)
  # Fused multiply-add contraction differs between call sites; results must not depend on inlining.
  target_compile_options(${target} PRIVATE -ffp-contract=off)
  if(SHIFTMAP_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${SHIFTMAP_SANITIZE} -fno-omit-frame-pointer)
    # As in Ceres, which is not built with sanitizers: what one of us allocates the other may free.
    target_compile_definitions(${target} PRIVATE EIGEN_MALLOC_ALREADY_ALIGNED=1)
    # A finding ends the test that made it.
    target_compile_options(${target} PRIVATE -fno-sanitize-recover=all)
    target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:Clang>:-fsanitize-ignorelist=${PROJECT_SOURCE_DIR}/tools/cmake/sanitizer_ignorelist.txt>)
    # What the sanitizers put in between hides from GCC what is initialized.
    target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
    target_link_options(${target} PUBLIC -fsanitize=${SHIFTMAP_SANITIZE})
  endif()
  if(SHIFTMAP_BUILD_FUZZERS)
    # A fuzzer steers by the branches that its input takes in the libraries.
    target_compile_options(${target} PRIVATE -fsanitize=fuzzer-no-link)
  endif()
endfunction()

# shiftmap_library(<name> HDRS ... SRCS ... [DEPS ...] [PRIVATE_DEPS ...])
# Makes shiftmap_<name> with the alias shiftmap::<name>; headers are included from the project root.
# It is installed in the component of find_package(shiftmap) that SHIFTMAP_COMPONENT names.
function(shiftmap_library name)
  cmake_parse_arguments(ARG "" "" "HDRS;SRCS;DEPS;PRIVATE_DEPS" ${ARGN})
  set(target shiftmap_${name})
  add_library(${target} STATIC ${ARG_SRCS})
  add_library(shiftmap::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  # Headers of tools are included by tools alone.
  if(NOT SHIFTMAP_COMPONENT STREQUAL "tools")
    set_target_properties(${target} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON)
  endif()
  target_sources(${target} PUBLIC FILE_SET HEADERS BASE_DIRS "${PROJECT_SOURCE_DIR}" FILES ${ARG_HDRS})
  target_include_directories(${target} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/shiftmap>)
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_link_libraries(${target} PUBLIC ${ARG_DEPS} PRIVATE ${ARG_PRIVATE_DEPS})
  shiftmap_private_options(${target})
  install(TARGETS ${target} EXPORT shiftmap_${SHIFTMAP_COMPONENT}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/shiftmap)
endfunction()

# shiftmap_hot_sources(<file>...): what a program of this folder spends its time in, mostly products
# of small matrices. -O3 unrolls these in the everyday build too, with the same bits.
function(shiftmap_hot_sources)
  set_source_files_properties(${ARGN}
    PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:RelWithDebInfo>:-O3>")
endfunction()

# shiftmap_binary(<name> SRCS ... DEPS ...): an installed executable.
function(shiftmap_binary name)
  cmake_parse_arguments(ARG "" "" "SRCS;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SRCS})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY "${PROJECT_BINARY_DIR}/bin")
  shiftmap_private_options(${name})
  install(TARGETS ${name} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endfunction()

# shiftmap_test(<name> LABEL unit|property|scenario|fault|... SRCS ... DEPS ...)
function(shiftmap_test name)
  cmake_parse_arguments(ARG "" "LABEL;TIMEOUT" "SRCS;DEPS" ${ARGN})
  if(NOT ARG_LABEL OR NOT ARG_SRCS)
    message(FATAL_ERROR "shiftmap_test(${name}) needs LABEL and SRCS")
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  if(SHIFTMAP_SANITIZE)
    math(EXPR ARG_TIMEOUT "10 * ${ARG_TIMEOUT}")
  endif()
  add_executable(${name} ${ARG_SRCS})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS} GTest::gmock GTest::gtest_main)
  shiftmap_private_options(${name})
  if(TARGET shiftmap_test_headers)
    target_precompile_headers(${name} REUSE_FROM shiftmap_test_headers)
    target_compile_options(${name} PRIVATE -O1 $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  endif()
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES LABELS ${ARG_LABEL} TIMEOUT ${ARG_TIMEOUT})
endfunction()

# shiftmap_bench(<name> SRCS ... DEPS ...): a benchmark that also runs, briefly, as a test, so that it cannot rot.
function(shiftmap_bench name)
  cmake_parse_arguments(ARG "" "" "SRCS;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SRCS})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS} benchmark::benchmark_main)
  shiftmap_private_options(${name})
  add_test(NAME ${name} COMMAND ${name} --benchmark_min_time=0.001)
  set_tests_properties(${name} PROPERTIES LABELS bench TIMEOUT 300)
endfunction()

# Installs the package files, so that find_package(shiftmap COMPONENTS ...) works.
function(shiftmap_install_package)
  include(CMakePackageConfigHelpers)
  set(dir "${CMAKE_INSTALL_LIBDIR}/cmake/shiftmap")
  configure_package_config_file(
    "${PROJECT_SOURCE_DIR}/tools/cmake/shiftmapConfig.cmake.in"
    "${PROJECT_BINARY_DIR}/shiftmapConfig.cmake" INSTALL_DESTINATION ${dir})
  write_basic_package_version_file(
    "${PROJECT_BINARY_DIR}/shiftmapConfigVersion.cmake" COMPATIBILITY SameMinorVersion)
  install(FILES "${PROJECT_BINARY_DIR}/shiftmapConfig.cmake"
    "${PROJECT_BINARY_DIR}/shiftmapConfigVersion.cmake" DESTINATION ${dir})
  foreach(component proto mapstore server localizer transfer mapper tools)
    install(EXPORT shiftmap_${component} FILE shiftmap-${component}.cmake NAMESPACE shiftmap::
      DESTINATION ${dir})
  endforeach()
endfunction()
