# SPDX-License-Identifier: Apache-2.0
# The target api_docs: HTML of what the headers say, in build/<preset>/api_docs. A warning is an error.
include_guard()

find_package(Doxygen 1.9.4)
if(NOT DOXYGEN_FOUND)
  return()
endif()

set(DOXYGEN_OUTPUT_DIRECTORY "${PROJECT_BINARY_DIR}/api_docs")
set(DOXYGEN_FILE_PATTERNS *.h)
set(DOXYGEN_BUILTIN_STL_SUPPORT YES)
set(DOXYGEN_QUIET YES)
set(DOXYGEN_JAVADOC_AUTOBRIEF YES)
set(DOXYGEN_EXTRACT_ALL YES)
set(DOXYGEN_HAVE_DOT NO)
# The prose above a function tells of its parameters; @param is for those that need more.
set(DOXYGEN_WARN_IF_INCOMPLETE_DOC NO)
set(DOXYGEN_WARN_AS_ERROR FAIL_ON_WARNINGS)
doxygen_add_docs(api_docs proto mapstore localizer mapper tools
  WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}" COMMENT "API documentation")
