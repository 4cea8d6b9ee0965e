# SPDX-License-Identifier: Apache-2.0
include_guard()

# shiftmap_proto_library(<name> FILES <path from the project root>.proto ...)
# Makes shiftmap_<name> with the alias shiftmap::<name> from Protobuf sources. Their headers are
# included as "proto/<file>.pb.h", are system headers (our warnings do not apply to generated code),
# and are not installed: link the target privately.
function(shiftmap_proto_library name)
  cmake_parse_arguments(ARG "" "" "FILES" ${ARGN})
  set(target shiftmap_${name})
  set(out_dir "${PROJECT_BINARY_DIR}/generated")
  file(MAKE_DIRECTORY "${out_dir}")
  set(generated "")
  foreach(file IN LISTS ARG_FILES)
    string(REGEX REPLACE "\\.proto$" ".pb" stem "${file}")
    add_custom_command(
      OUTPUT "${out_dir}/${stem}.cc" "${out_dir}/${stem}.h"
      COMMAND protobuf::protoc "--proto_path=${PROJECT_SOURCE_DIR}" "--cpp_out=${out_dir}" "${file}"
      DEPENDS "${PROJECT_SOURCE_DIR}/${file}"
      WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}"
      COMMENT "protoc ${file}"
      VERBATIM)
    list(APPEND generated "${out_dir}/${stem}.cc" "${out_dir}/${stem}.h")
  endforeach()
  add_library(${target} STATIC ${generated})
  add_library(shiftmap::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name} CXX_CLANG_TIDY "" UNITY_BUILD OFF)
  target_include_directories(${target} SYSTEM PUBLIC $<BUILD_INTERFACE:${out_dir}>)
  target_link_libraries(${target} PUBLIC protobuf::libprotobuf)
  if(SHIFTMAP_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${SHIFTMAP_SANITIZE})
    target_link_options(${target} PUBLIC -fsanitize=${SHIFTMAP_SANITIZE})
  endif()
  install(TARGETS ${target} EXPORT shiftmap_${SHIFTMAP_COMPONENT} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
endfunction()

# shiftmap_grpc_library(<name> FILES <path from the project root>.proto ... [DEPS ...])
# The same with the services in them: "proto/<file>.grpc.pb.h". DEPS: the libraries of the messages
# that the files import.
function(shiftmap_grpc_library name)
  cmake_parse_arguments(ARG "" "" "FILES;DEPS" ${ARGN})
  shiftmap_proto_library(${name} FILES ${ARG_FILES})
  set(target shiftmap_${name})
  set(out_dir "${PROJECT_BINARY_DIR}/generated")
  foreach(file IN LISTS ARG_FILES)
    string(REGEX REPLACE "\\.proto$" ".grpc.pb" stem "${file}")
    add_custom_command(
      OUTPUT "${out_dir}/${stem}.cc" "${out_dir}/${stem}.h"
      COMMAND protobuf::protoc "--proto_path=${PROJECT_SOURCE_DIR}" "--grpc_out=${out_dir}"
        "--plugin=protoc-gen-grpc=$<TARGET_FILE:gRPC::grpc_cpp_plugin>" "${file}"
      DEPENDS "${PROJECT_SOURCE_DIR}/${file}"
      WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}"
      COMMENT "protoc ${file} (services)"
      VERBATIM)
    target_sources(${target} PRIVATE "${out_dir}/${stem}.cc" "${out_dir}/${stem}.h")
  endforeach()
  target_link_libraries(${target} PUBLIC ${ARG_DEPS} gRPC::grpc++)
endfunction()
